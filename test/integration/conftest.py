"""Real processes over DDS: a domain of its own for each test, and nothing left running."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from interface_packages import build
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

REPOSITORY = Path(__file__).parents[2]

# Above what people choose for their robots, below the range of ephemeral ports.
DOMAINS = range(61, 101)

BOUND = 100.0
"""Longest wait for anything [s]: a busy machine takes its time, and only a failure takes it all."""


def _wait_until(
    condition: Callable[[], Any], timeout: float = BOUND, step: Callable[[], Any] | None = None
) -> Any:
    """Return the condition's first true value; fail when there is none in time.

    Args:
        condition: Called again and again.
        timeout: Limit [s].
        step: What to do between two looks, such as spinning a node; a short wait when absent.

    """
    end = time.monotonic() + timeout
    while not (value := condition()):
        assert time.monotonic() < end, f'not so within {timeout} s: {condition}'
        time.sleep(0.01) if step is None else step()
    return value


@pytest.fixture
def wait_until() -> Callable[..., Any]:
    """The bounded wait of all tests here: `wait_until(condition, timeout=BOUND, step=None)`."""
    return _wait_until


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[int]:
    """A free ROS domain on this machine only, set in the environment and held until the end."""
    workers = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    for domain in DOMAINS[worker::workers]:
        with suppress(OSError), _held(domain):
            monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
            monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
            monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
            monkeypatch.setenv('ROS_PYTHON_CHECK_FIELDS', '1')
            yield domain
            return
    pytest.fail('no free ROS domain on this machine')


@contextmanager
def _held(domain: int) -> Iterator[None]:
    """Hold a domain nobody uses, not even a process that a run before left behind.

    Participant k of a domain receives at 7410 + 250 * domain + 2 * k. The last port of the domain,
    which none of its participants comes to use, is our claim against other test runs.
    """
    base = 7400 + 250 * domain
    with socket.socket(type=socket.SOCK_DGRAM) as claim:
        claim.bind(('127.0.0.1', base + 249))
        with ExitStack() as ports:
            for port in range(base + 10, base + 30):
                each = ports.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                each.bind(('127.0.0.1', port))
        yield


@dataclass
class Running:
    """A process under test, its output in files."""

    process: subprocess.Popen[bytes]
    out: Path
    err: Path

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def stdout(self) -> str:
        return self.out.read_text()

    @property
    def stderr(self) -> str:
        return self.err.read_text()

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def wait(self, timeout: float = BOUND) -> int:
        """Return the exit code; fail when the process does not end in time."""
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            pytest.fail(f'still running after {timeout} s: {self.process.args}\n{self.stderr}')

    def end(self) -> None:
        """Stop it as a user does; kill it when it does not listen."""
        if self.process.poll() is None:
            self.signal(signal.SIGINT)
            try:
                self.process.wait()
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


@pytest.fixture
def spawn(
    ros_domain: int, tmp_path: Path, interruptible: Callable[[], AbstractContextManager[None]]
) -> Iterator[Callable[..., Running]]:
    """Start processes in `tmp_path`: `spawn(args, **env)`; all are stopped at the end.

    The arguments are a whole command, as in `[sys.executable, "-m", ...]`.
    """
    started: list[Running] = []

    def start(args: Sequence[str | Path], **env: str) -> Running:
        out = tmp_path / f'process_{len(started)}.out'
        err = out.with_suffix('.err')
        paths = [str(REPOSITORY), os.environ.get('PYTHONPATH', '')]
        inherited = {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, paths))}
        with out.open('wb') as stdout, err.open('wb') as stderr, interruptible():
            process = subprocess.Popen(
                [str(each) for each in args],
                cwd=tmp_path,
                env={**inherited, **env},
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
            )
        started.append(Running(process, out, err))
        return started[-1]

    yield start
    for each in reversed(started):
        each.end()


@pytest.fixture(scope='session')
def _interfaces(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    return cache(lambda package: build(package, tmp_path_factory.mktemp(package)))


@pytest.fixture
def interfaces(
    _interfaces: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], None]:
    """Have this process and those to be started import a package: `interfaces('tf2_msgs')`."""

    def add(package: str) -> None:
        folder = _interfaces(package)
        monkeypatch.syspath_prepend(folder)
        paths = [str(folder), os.environ.get('PYTHONPATH', '')]
        monkeypatch.setenv('PYTHONPATH', os.pathsep.join(filter(None, paths)))

    return add


@dataclass
class Ros:
    """A node in the test's own process, with a context of its own."""

    node: Node
    executor: SingleThreadedExecutor
    clients: dict[str, Any] = field(default_factory=dict)

    def spin_until(self, condition: Callable[[], Any], timeout: float = BOUND) -> Any:
        """Spin until the condition is true, and return its value; fail when it is not in time."""
        return _wait_until(condition, timeout, lambda: self.executor.spin_once(timeout_sec=0.01))

    def client(self, kind: Any, name: str) -> Any:
        """The client of a service."""
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, name)
        return self.clients[name]

    def call(self, kind: Any, name: str, request: Any = None) -> Any:
        """Call a service, and return its answer."""
        client = self.client(kind, name)
        self.spin_until(client.service_is_ready)
        answer = client.call_async(kind.Request() if request is None else request)
        self.spin_until(answer.done)
        return answer.result()


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """A node `tester` to publish, subscribe and call from."""
    context = Context()
    context.init(args=[], domain_id=ros_domain)
    node = Node('tester', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield Ros(node, executor)
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()
