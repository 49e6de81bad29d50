"""The nodes of a run as operating-system processes in their own ROS domain, and its folder."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

from cmpsp_ros.nodes import MODULES, interruptions_held


class DemoError(RuntimeError):
    """A run could not be started or did not end; the message says why."""


_STOP_TIMEOUT = 10.0

_LEAST_SPACE = 4096  # on a disk with less free space a log may lack its end [bytes]
_COMPILES = 'Compiling kernels'  # text that `ProgressLine` shows every few seconds
_DOMAINS = range(1, 101)
_RCLPY_OF_FAST_DDS_3 = 8
_PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_PR_SET_PDEATHSIG = 1
_claims: list[socket.socket] = []
_prctl = ctypes.CDLL(None).prctl if sys.platform == 'linux' else None


def use_free_domain() -> int:
    """Choose a ROS domain that is unused on this machine, and keep all traffic on loopback.

    It is set in this process' environment, which its children inherit.
    """
    # Where to begin differs between processes, so that two that start together do not collide.
    offset = os.getpid() % len(_DOMAINS)
    for candidate in (*_DOMAINS[offset:], *_DOMAINS[:offset]):
        if _is_free(candidate):
            _claim(candidate)
            os.environ['ROS_DOMAIN_ID'] = str(candidate)
            os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
            # Fast DDS 3, from Kilted on, has other names for these.
            if int(version('rclpy').partition('.')[0]) < _RCLPY_OF_FAST_DDS_3:
                os.environ.setdefault(_PROFILES, str(Path(__file__).with_name('fastdds.xml')))
            return candidate
    raise DemoError(f'ROS domains {_DOMAINS[0]} to {_DOMAINS[-1]} are all in use on this machine')


def _is_free(domain: int) -> bool:
    """True if no DDS participant has the first unicast port of a domain, and nobody a claim."""
    # Its first unicast port: RTPS 2.2, 9.6.1.1.
    for port in (7400 + 250 * domain + 10, _last_port(domain)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('127.0.0.1', port))
            except OSError:
                return False
    return True


def _claim(domain: int) -> None:
    """Keep other runs out of a domain until nodes of this one have joined it, and after."""
    while _claims:
        _claims.pop().close()
    claim = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    _claims.append(claim)
    with suppress(OSError):
        claim.bind(('127.0.0.1', _last_port(domain)))


def _last_port(domain: int) -> int:
    """A port of a domain that none of its participants uses."""
    return 7400 + 250 * domain + 249


@dataclass(frozen=True)
class Child:
    """A node running as a process, with its log; its name has the namespace before it, if any."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path

    @classmethod
    def start(
        cls, name: str, ros_arguments: Sequence[str], folder: Path, namespace: str = ''
    ) -> Child:
        """Start a program of `cmpsp_ros.nodes.MODULES`; each namespace has a folder of logs."""
        log = folder / namespace.strip('/') / f'{name}.log'
        log.parent.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, '-m', MODULES.get(name, name), '--ros-args', *ros_arguments]
        if namespace:
            command += ['-r', f'__ns:={namespace}']
        with log.open('wb') as output, interruptions_held():
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                # Ctrl-C in the terminal is for us: the nodes are stopped in good order.
                start_new_session=True,
                # It makes one system call and takes no lock, so threads of ours do not matter.
                preexec_fn=_die_with_parent,  # noqa: PLW1509
            )
        return cls(f'{namespace}/{name}' if namespace else name, process, log)

    def check(self) -> None:
        """Raise `DemoError` with the end of its log if the process has ended by itself."""
        code = self.process.poll()
        if code is not None:
            raise DemoError(f'{self.name} ended with exit code {code}:\n{self.last_words()}')

    def ask(self, refusal: str, change: Callable[[], bool]) -> None:
        """Request a state change of a guidance node; `change` returns True if it agreed."""
        try:
            agreed = change()
        except TimeoutError as error:
            self.check()
            raise DemoError(f'{error}; it said:\n{self.last_words()}') from None
        if not agreed:
            raise DemoError(f'{self.name} {refusal}:\n{self.last_words()}')

    def interrupt(self) -> None:
        """Ask the process to end."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)

    def stop(self) -> int:
        """Ask the process to end, and insist after ten seconds; its exit code."""
        self.interrupt()
        try:
            return self.process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def still_compiles(self) -> bool:
        """True if a node that has not answered in time reports that it is compiling kernels."""
        said = [each for each in self.last_words().splitlines() if _COMPILES in each]
        if self.process.poll() is not None or not said:
            return False
        sys.stderr.write(f'{self.name}: {said[-1][said[-1].index(_COMPILES) :]}\n')
        return True

    def warnings(self) -> list[str]:
        """Warnings of its log."""
        lines = self.log.read_text(errors='replace').splitlines()
        return [each.partition(']: ')[2] for each in lines if each.startswith('[WARN]')]

    def last_words(self) -> str:
        """Last lines of its log, and the space it lacks if the disk is full."""
        lines = self.log.read_text(errors='replace').splitlines()[-5:]
        if shutil.disk_usage(self.log).free < _LEAST_SPACE:
            lines.append(f'{self.log.parent}: no space is left on this disk')
        return '\n'.join(lines)


def check_all(children: Iterable[Child]) -> None:
    """Check that no node has ended by itself; raises `DemoError`."""
    for child in children:
        child.check()


def stop_all(children: Iterable[Child]) -> None:
    """Stop nodes one kind after another, in the reverse order of their start."""
    started = reversed(list(children))
    for _, alike in groupby(started, key=lambda each: each.name.rpartition('/')[2]):
        kind = list(alike)
        for each in kind:
            each.interrupt()
        for each in kind:
            each.stop()


def _die_with_parent() -> None:
    """Have the kernel stop this process when its parent is killed (Linux only)."""
    if _prctl is not None:
        _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


_RUNS = Path('runs')
_CONTENT = (
    'bag',
    'parameters.yaml',
    'summary.json',
    'trajectory.png',
    'wheel_speeds.png',
    'recorder.log',
    'sim_node.log',
    'guidance_node.log',
    'viewer.log',
)


def make_folder(output: Path | None, *, force: bool) -> Path:
    """Create the folder of a run, `runs/<time>` by default; `force` replaces an earlier run."""
    folder = output or _RUNS / datetime.now().astimezone().strftime('%Y-%m-%d_%H-%M-%S')
    try:
        if folder.exists():
            if not folder.is_dir():
                raise DemoError(f'{folder}: found a file, wanted a new folder')
            if not force:
                raise DemoError(
                    f'{folder}: found an existing folder, wanted a new one; --force replaces the'
                    ' run in it'
                )
            _clear(folder)
        folder.mkdir(parents=True, exist_ok=True)
        if output is None:
            latest = _RUNS / 'latest'
            latest.unlink(missing_ok=True)
            latest.symlink_to(folder.name)
    except OSError as error:
        raise DemoError(f'{folder}: {error.strerror or error}') from error
    return folder


def _clear(folder: Path) -> None:
    robots = [each.parent.name for each in folder.glob('*/guidance_node.log')]
    for name in (*_CONTENT, *robots):
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
