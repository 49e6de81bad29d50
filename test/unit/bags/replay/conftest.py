"""Bags of a guidance law that drives an exact robot in this process, as its node would."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from bag_messages import odometry
from recorded_drives import START, Drive, altered

from cmpsp_ros.bags import Names
from cmpsp_ros.bags.replay.replay import replay


@pytest.fixture
def drive(tmp_path):
    """Begin a recorded drive of case 3: `drive(**parameters)`, in `tmp_path / 'bag'`."""
    return lambda folder='bag', **how: Drive(tmp_path / folder, **how)


@pytest.fixture
def bag(tmp_path):
    return tmp_path / 'bag'


@pytest.fixture(scope='session')
def short(tmp_path_factory):
    """A bag of half a second, three decisions; and these."""
    folder = tmp_path_factory.mktemp('short') / 'bag'
    with Drive(folder) as run:
        run.go(0.5)
    return folder, run.decisions


@pytest.fixture
def replayed(short, tmp_path):
    """Replay the short bag after a change: `replayed(change, tolerance)`."""

    def replayed(change, tolerance=None, **more):
        copy = altered(short[0], tmp_path / str(len(list(tmp_path.iterdir()))), change, **more)
        return replay(copy, Names.under(''), tolerance)

    return replayed


@pytest.fixture
def alter(bag, tmp_path):
    """Copy the bag with changes: `alter(change, parameters=None)`; returns the copy."""
    return lambda *what, **more: altered(bag, tmp_path / 'altered', *what, **more)


@pytest.fixture(scope='session')
def faulty(tmp_path_factory):
    """A bag of a run with everything that can happen to a law; and its decisions."""
    folder: Path = tmp_path_factory.mktemp('faulty') / 'bag'
    with Drive(folder) as run:
        run.go(1.0)
        run.go(0.6, heard=False)
        run.halt()
        run.go(0.2, heard=False)
        run.halt()
        run.go(1.0)
        # Refused, so that the robot stops, and again within the same control period.
        for pose in ((math.nan, 0.0, 0.0), (math.nan, 0.0, 0.0)):
            run.say(odometry(run.now, pose))
            run.tick()
        run.halt('Odometry has a pose that is not finite.')
        run.go(1.0)
        run.change(obstacles__b__radius=0.6)
        run.change(obstacles__a__center=[8.1, -6.0], weights__road_center=20.0)
        run.go(1.0)
        run.change(obstacles__b__radius=0.5)
        run.activate()
        run.pose = np.array(START)
        run.go(1.0)
        # Off the road, where nothing but going back is audited well.
        run.pose = np.array([0.0, -11.5, 0.0])
        run.go(1.0)
        run.halt('The guidance node is shutting down.')
    return folder, run.decisions
