"""Run after run with the same two processes, in lockstep: what do they take, and give back?

`python test/integration/guidance/soak.py --minutes 60` drives Case 3 again and again for an hour of
simulated time, with a new activation and a reset in between, and prints what the two hold as it
goes on.
Exit code 1 if memory grows by more than 5 %, or anything else at all.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from cmpsp_ros.nodes import MODULES

ROOT = Path(__file__).parents[3]
CASE = ROOT / 'config' / 'case3.yaml'
PARAMETERS = {
    'sim': ('lockstep:=true', 'publish_clock:=true', 'lockstep_timeout:=60.0'),
    'guidance': ('use_sim_time:=true', 'autostart:=true'),
}
RUN = 10.0
"""Simulated time of a run [s]."""

WARM = 5
"""Runs until caches and the pools of the middleware have filled."""

GROWTH = 1.05
LIMIT = 250.0
"""Longest wait for anything [s]."""


@dataclass(frozen=True)
class Held:
    """Memory and handles of two processes.

    Attributes:
        memory: Resident [MB], guidance and sim.
        descriptors: Open files, guidance and sim.
        shared: Entries of ``/dev/shm``.
    """

    memory: tuple[float, float]
    descriptors: tuple[int, int]
    shared: int

    @classmethod
    def by(cls, nodes):
        pages = [int(Path(f'/proc/{each.pid}/statm').read_text().split()[1]) for each in nodes]
        memory = tuple(round(each * os.sysconf('SC_PAGE_SIZE') / 2**20, 2) for each in pages)
        files = tuple(_count(f'/proc/{each.pid}/fd') for each in nodes)
        return cls(memory, files, shared_entries())


def shared_entries():
    """Entries of ``/dev/shm``, of all processes on this machine."""
    return _count('/dev/shm')


def _count(folder):
    return sum(1 for _ in Path(folder).iterdir())


class Client:
    """Waits for the ends of runs, and has them begun again."""

    def __init__(self):
        self.node = rclpy.create_node('soak')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.latest = {}
        self.node.create_subscription(DiagnosticArray, '/guidance/decision', self._note, 1000)
        self.node.create_subscription(Odometry, '/odom', self._hear, 1000)
        self.stamp, self.repeated = None, 0
        self.reset = self.node.create_client(Trigger, '/sim/reset')
        self.change_state = self.node.create_client(ChangeState, '/guidance/change_state')

    def _note(self, message):
        self.latest = {each.key: each.value for each in message.status[0].values}

    def _hear(self, message):
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        self.repeated = self.repeated + 1 if stamp == self.stamp else 0
        self.stamp = stamp

    def until(self, condition):
        end = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < end, f'not so within {LIMIT} s; last decision {self.latest}'
            self.executor.spin_once(timeout_sec=0.05)

    def finish(self, run):
        """Wait until a run has finished, and see that it arrived."""
        self.until(lambda: (self.latest.get('run'), self.latest.get('finished')) == (run, 'true'))
        assert self.latest['missed'] == 'false', self.latest

    def begin_again(self):
        """Put the robot back and set time 0 anew, while simulated time stands still."""
        self.call(self.change_state, _to(Transition.TRANSITION_DEACTIVATE))
        self.repeated = 0
        self.until(lambda: self.repeated > 2)
        self.call(self.reset, Trigger.Request())
        self.call(self.change_state, _to(Transition.TRANSITION_ACTIVATE))

    def call(self, client, request):
        self.until(client.service_is_ready)
        answer = client.call_async(request)
        self.until(answer.done)
        assert answer.result().success, request


def _to(transition):
    return ChangeState.Request(transition=Transition(id=transition))


def start(name, folder):
    """A node as a process, its words in a file."""
    flags = [part for each in PARAMETERS[name] for part in ('-p', each)]
    module = MODULES[f'{name}_node']
    command = [sys.executable, '-m', module, '--ros-args', '--params-file', CASE, *flags]
    with (folder / f'{name}.log').open('wb') as log:
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)


def soak(runs, every, nodes):
    """Drive so many runs; yields what the nodes hold after every so many of them."""
    client = Client()
    for number in range(runs):
        client.finish(str(1 + number))
        if number + 1 >= WARM and (number + 1 - WARM) % every == 0:
            yield number + 1, Held.by(nodes)
        if number + 1 < runs:
            client.begin_again()
    client.node.destroy_node()


def grown(first, last):
    """Growth of the nodes between the first runs and the end, in words."""
    found = []
    for number, name in enumerate(('guidance', 'sim')):
        if last.memory[number] > GROWTH * first.memory[number]:
            found.append(f'memory of {name}')
        if last.descriptors[number] > first.descriptors[number]:
            found.append(f'descriptors of {name}')
    return found


def main():
    """Start both nodes, let them run, and say what they took."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--minutes', type=float, default=60.0)
    parser.add_argument('--every', type=int, default=30, help='runs between two looks')
    args = parser.parse_args()
    runs = max(WARM + 1, round(args.minutes * 60.0 / RUN))
    rclpy.init()
    before, looks = shared_entries(), []
    with TemporaryDirectory() as folder:
        nodes = [start(name, Path(folder)) for name in ('guidance', 'sim')]
        try:
            for number, held in soak(runs, min(args.every, runs - WARM), nodes):
                looks.append(held)
                print(f'run {number}: {held}', flush=True)
        finally:
            for each in nodes:
                each.terminate()
            codes = [each.wait(LIMIT) for each in nodes]
    rclpy.shutdown()
    left = shared_entries() - before
    said = {'runs': runs, 'grown': grown(looks[0], looks[-1]), 'codes': codes, 'shared': left}
    print(json.dumps(said))
    return 1 if said['grown'] or any(codes) else 0


if __name__ == '__main__':
    sys.exit(main())
