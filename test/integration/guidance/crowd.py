"""Run after run among 64 moving discs in real time, beside a busy loop on one core: is all clear?

`python test/integration/guidance/crowd.py --runs 50` makes one run with each seed from 1 on, has
each audited, and prints what it keeps from the road's edges and from the discs.
Exit code 1 if one of them is not clear.
"""

import argparse
import json
import math
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.audit import CheckOutcome, audit

DISCS, ON_THE_ROAD = 64, 10
CHECKS = 'road', 'moving'
MARGIN = 0.05
"""Clearance that plans keep: in real time a disc is seen where it was a little earlier [m]."""

LATEST = 0.2
"""By when a command takes effect [s]."""


def parameters(seed):
    """Case 3 with discs that drift on its road, and others that circle beside it."""
    random = np.random.default_rng(seed)
    moving = {'capacity': DISCS, 'names': [f'disc_{k:02d}' for k in range(DISCS)]}
    bearings = np.radians(np.linspace(-75.0, -8.0, ON_THE_ROAD))
    for k, name in enumerate(moving['names']):
        if k < ON_THE_ROAD:
            away, bearing = random.uniform(9.2, 10.8), bearings[k]
            velocity = random.uniform(-0.1, 0.1, 2).tolist()
        else:
            away, bearing = random.uniform(11.5, 14.0), random.uniform(-math.pi, 0.5)
            velocity = [-0.3 * math.sin(bearing), 0.3 * math.cos(bearing)]
        center = [float(away * math.cos(bearing)), float(away * math.sin(bearing))]
        moving[name] = {'center': center, 'velocity': velocity, 'radius': 0.12}
    return {
        'moving_obstacles': moving,
        'robot': {'max_wheel_speed': 51.0},
        'safety': {'margin': MARGIN},
        # The computer is late at times, beside a busy loop and whatever else there is.
        'max_command_delay': LATEST,
        'initial_pose': [0.0, -9.25, 0.0],
    }


def run(seed, folder):
    """Make a run; the outcome of each check, and its worst figure [m]."""
    path, output = folder / 'crowd.yaml', folder / str(seed)
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters(seed)}}))
    command = [sys.executable, '-m', 'cmpsp_ros.cli', 'demo', path, '--output', output]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        findings = {each.check: each for each in audit(output / 'bag')}
    except BagError as error:
        raise SystemExit(f'{made.stdout}{made.stderr}{error}') from None
    clear = all(findings[name].outcome is not CheckOutcome.FAILED for name in CHECKS)
    reached = findings['goal'].outcome is CheckOutcome.PASSED
    return {
        'seed': seed,
        'clear': clear,
        'reached': reached,
        **{name: findings[name].worst for name in CHECKS},
    }


def keep_busy():
    """Leave no time of the first core to anybody who does not fight for it."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    while True:
        pass


def main():
    """Make them."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--runs', type=int, default=50)
    args = parser.parse_args()
    busy = multiprocessing.Process(target=keep_busy, daemon=True)
    busy.start()
    made = []
    with TemporaryDirectory() as folder:
        for seed in range(1, args.runs + 1):
            made.append(run(seed, Path(folder)))
            print(json.dumps(made[-1]), flush=True)
    busy.terminate()
    total = {'runs': len(made), 'clear': sum(each['clear'] for each in made)}
    least = {name: min(each[name] for each in made) for name in CHECKS}
    print(json.dumps({**total, 'reached': sum(each['reached'] for each in made), **least}))
    sys.exit(total['clear'] < total['runs'])


if __name__ == '__main__':
    main()
