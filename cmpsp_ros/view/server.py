"""The state shown at present, and the HTTP server of the page and its data.

It listens on loopback unless configured otherwise, and then requires a token. It is read-only and
answers its own page only: other sites cannot read it, not even by a host name that resolves to this
machine. Browsers poll for updates. A slow one skips states, so nothing is queued for it.
"""

from __future__ import annotations

import ipaddress
import json
import math
import os
import re
import secrets
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, ClassVar, Final
from urllib.parse import parse_qs, urlsplit

# Environment variable with the token; without it each server makes one of its own.
#
# Neither an argument nor a parameter, which all can read who see the processes or the graph.
VARIABLE: Final = 'CMPSP_VIEW_TOKEN'

_BYTES: Final = 16
_TOKEN: Final = re.compile(r'[A-Za-z0-9_-]{8,}')
_COOKIE: Final = 'cmpsp_view_token'


class ViewError(ValueError):
    """The view cannot be served; names the address, the found and the expected value."""


class Access:
    """Decides for each request if it is answered."""

    def __init__(self, host: str) -> None:
        is_loopback = _is_loopback(host)
        # A foreign site can give its own name this machine's address, and would then be the same
        # site. Elsewhere the token keeps it out.
        self._names = {host, 'localhost', '127.0.0.1'} if is_loopback else None
        self.token = '' if is_loopback else _token()

    def is_by_name(self, host: str) -> bool:
        """True if the header `Host` names this machine."""
        return self._names is None or urlsplit(f'//{host}').hostname in self._names

    def knows(self, cookies: str) -> bool:
        """True if the header `Cookie` has the token, or none is needed."""
        try:
            kept = SimpleCookie(cookies).get(_COOKIE)
        except CookieError:
            kept = None
        return not self.token or (kept is not None and self._is_token(kept.value))

    def enters(self, query: str) -> bool:
        """True if the query of an address has the token."""
        return bool(self.token) and self._is_token(parse_qs(query).get('token', [''])[-1])

    def cookie(self) -> str:
        """Header `Set-Cookie` for a valid token, hidden from scripts and other sites."""
        return f'{_COOKIE}={self.token}; Path=/; HttpOnly; SameSite=Strict'

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self.token.encode())


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == 'localhost'


def _token() -> str:
    token = os.environ.get(VARIABLE, '')
    if not token:
        return secrets.token_urlsafe(_BYTES)
    if not _TOKEN.fullmatch(token):
        # Not itself: errors are logged.
        msg = f'{VARIABLE}: found another token than wanted, 8 or more letters, digits, - and _'
        raise ViewError(msg)
    return token


_PAGES: Final = {
    '/': ('page.html', 'text/html; charset=utf-8'),
    '/page.css': ('page.css', 'text/css; charset=utf-8'),
    '/page.js': ('page.js', 'text/javascript; charset=utf-8'),
}
_HEADERS: Final = {
    # Nothing from elsewhere, and nothing that is written into the page itself.
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self';"
        ' img-src data:;'
        " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Cache-Control': 'no-store',
}
_NOTHING: Final[Mapping[str, str]] = {}
_LOCKED: Final = b'Open the address with the token, which the viewer wrote when it began.\n'
_IDLE_TIMEOUT: Final = 30.0


class ViewServer:
    """Serves the shared state in its own thread."""

    def __init__(self, state: SharedState, host: str, port: int) -> None:
        """Open the port on an address, 0 for any that is free; raises ViewError."""
        self._access = Access(host)
        handler = type('_Handler', (_Handler,), {'state': state, 'access': self._access})
        try:
            self._server = ThreadingHTTPServer((host, port), handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, 'strerror', None) or error
            msg = f'{host}, port {port}: found {reason}, wanted an address and a port that is free'
            raise ViewError(msg) from error
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def address(self) -> str:
        """Address of the page, with the token if there is one."""
        host, port = self._server.server_address[:2]
        token = self._access.token
        return f'http://{host!s}:{port}/' + (f'?token={token}' if token else '')

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def close(self) -> None:
        """Stop; responses in progress are cut off."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.server_close()


class _Handler(BaseHTTPRequestHandler):
    """Answers one browser."""

    state: ClassVar[SharedState]
    access: ClassVar[Access]
    protocol_version = 'HTTP/1.1'
    timeout = _IDLE_TIMEOUT
    server_version = 'cmpsp'
    sys_version = ''

    def do_GET(self) -> None:
        """Send a part of the page, or updates."""
        url = urlsplit(self.path)
        if not self.access.is_by_name(self.headers.get('Host', '')):
            self._send(HTTPStatus.FORBIDDEN, b'Not by this name.\n', 'text/plain')
        elif url.path == '/' and self.access.enters(url.query):
            # On to the page without the token, which so stays out of sight and of histories.
            enter = {'Location': '/', 'Set-Cookie': self.access.cookie()}
            self._send(HTTPStatus.SEE_OTHER, b'', 'text/plain', enter)
        elif not self.access.knows(self.headers.get('Cookie', '')):
            self._send(HTTPStatus.UNAUTHORIZED, _LOCKED, 'text/plain')
        elif url.path == '/updates':
            self._send_updates(url.query)
        elif url.path in _PAGES:
            name, kind = _PAGES[url.path]
            asset = (files('cmpsp_ros.view') / 'assets' / name).read_bytes()
            self._send(HTTPStatus.OK, asset, kind)
        else:
            self._send(HTTPStatus.NOT_FOUND, b'There is nothing here.\n', 'text/plain')

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 (named by http.server)
        """Log nothing: a page sends many requests a second."""

    def _send_updates(self, query: str) -> None:
        try:
            known = _client_state(query)
        except ValueError:
            self._send(HTTPStatus.BAD_REQUEST, b'Wanted whole numbers.\n', 'text/plain')
            return
        updates = json.dumps(self.state.updates(known), allow_nan=False, separators=(',', ':'))
        self._send(HTTPStatus.OK, updates.encode(), 'application/json')

    def _send(
        self, status: HTTPStatus, body: bytes, kind: str, more: Mapping[str, str] = _NOTHING
    ) -> None:
        self.send_response(status)
        for name, value in (*_HEADERS.items(), *more.items()):
            self.send_header(name, value)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def _client_state(query: str) -> ClientState:
    """State that a browser reports to have; raises ValueError for other than whole numbers."""
    numbers = {key: int(values[-1]) for key, values in parse_qs(query).items()}
    if any(value < -1 for value in numbers.values()):
        raise ValueError(query)
    course, run = numbers.pop('course', -1), numbers.pop('run', -1)
    return ClientState(course, run, {name: max(rows, 0) for name, rows in numbers.items()})


LONGEST: Final = 20_000  # rows of a series; one that is full begins again


@dataclass(frozen=True)
class ClientState:
    """The state that a browser already has: numbers of its course and run, rows of each series."""

    course: int = -1
    run: int = -1
    rows: dict[str, int] = field(default_factory=dict)


class SharedState:
    """The latest value of everything, and time series of the present run."""

    def __init__(self, series: Sequence[str]) -> None:
        self._lock = threading.Lock()
        self._latest: dict[str, Any] = {}
        self._course: Any = None
        self._course_number = 0
        self._run = 0
        self._series: dict[str, list[list[Any]]] = {name: [] for name in series}
        self._received: float | None = None

    def show(self, name: str, value: Any) -> None:
        """Replace the value of a name."""
        with self._lock:
            self._latest[name] = _plain(value)

    def show_course(self, course: Any) -> None:
        """Replace the static part: it is large, and sent to each browser once."""
        with self._lock:
            self._course, self._course_number = _plain(course), self._course_number + 1

    def add(self, series: str, row: Sequence[Any]) -> None:
        """Add a row to a series."""
        with self._lock:
            rows = self._series[series]
            if len(rows) >= LONGEST:
                self._clear()
            rows.append(_plain(row))

    def begin(self) -> None:
        """Begin another run: all series are empty."""
        with self._lock:
            self._clear()

    def alive(self) -> None:
        """Note that something was received now."""
        with self._lock:
            self._received = time.monotonic()

    def updates(self, known: ClientState) -> dict[str, Any]:
        """Everything that a browser does not have, as plain values for JSON."""
        with self._lock:
            same = known.run == self._run
            first = {name: known.rows.get(name, 0) if same else 0 for name in self._series}
            updates: dict[str, Any] = {
                **self._latest,
                'course_number': self._course_number,
                'run': self._run,
                'first': first,
                'series': {name: rows[first[name] :] for name, rows in self._series.items()},
                'silence': None if self._received is None else time.monotonic() - self._received,
            }
            if known.course != self._course_number:
                updates['course'] = self._course
            return updates

    def _clear(self) -> None:
        self._run += 1
        for rows in self._series.values():
            rows.clear()


def _plain(value: Any) -> Any:
    """A value for JSON: NaN and infinity become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return value
