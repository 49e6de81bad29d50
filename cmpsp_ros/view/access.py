"""Access to the page: everybody on loopback, elsewhere only with the token."""

from __future__ import annotations

import ipaddress
import os
import re
import secrets
from http.cookies import CookieError, SimpleCookie
from typing import Final
from urllib.parse import parse_qs, urlsplit

VARIABLE: Final = 'CMPSP_VIEW_TOKEN'
"""Environment variable with the token; without it each server makes one of its own.

Neither an argument nor a parameter, which all can read who see the processes or the graph.
"""

_BYTES: Final = 16
_TOKEN: Final = re.compile(r'[A-Za-z0-9_-]{8,}')
_COOKIE: Final = 'cmpsp_view_token'


class ViewError(ValueError):
    """The view cannot be served; the message says where, what was found and what was expected."""


class Access:
    """Decides for each request whether it is answered.

    Attributes:
        token: The token required; empty on loopback, which other machines cannot reach.
    """

    def __init__(self, host: str) -> None:
        """Protect a server.

        Raises:
            ViewError: The token of the environment is not fit to be one.
        """
        is_loopback = _is_loopback(host)
        # A foreign site can give its own name this machine's address, and would then be the same
        # site. Elsewhere the token keeps it out.
        self._names = {host, 'localhost', '127.0.0.1'} if is_loopback else None
        self.token = '' if is_loopback else _token()

    def is_by_name(self, host: str) -> bool:
        """Whether the header `Host` names a machine by which this one may be asked."""
        return self._names is None or urlsplit(f'//{host}').hostname in self._names

    def knows(self, cookies: str) -> bool:
        """Whether the header `Cookie` has the token, or none is needed."""
        try:
            kept = SimpleCookie(cookies).get(_COOKIE)
        except CookieError:
            kept = None
        return not self.token or (kept is not None and self._is_token(kept.value))

    def enters(self, query: str) -> bool:
        """Whether the query of an address has the token."""
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
