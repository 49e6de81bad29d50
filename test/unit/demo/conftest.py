"""Bags of runs that never happened."""

from __future__ import annotations

import pytest
from bag_messages import JOINTS, ODOMETRY, PLAIN_DECISION, STATUS, joints, odometry, raw, status

from cmpsp_ros.bags import BagWriter


def decision(stamp, level='nominal', finished=False, step_ms=None, **more):
    told = {'stamp': stamp, 'fallback_level': level, 'finished': str(finished).lower()}
    timed = {} if step_ms is None else {'step_ms': repr(step_ms)}
    return status(f'It is {level}.', **PLAIN_DECISION | told | more | timed)


@pytest.fixture
def write_bag(tmp_path):
    """Write a bag of `truth` (stamp, pose, twist), `wheels` (stamp, speeds) and `decisions`."""

    def write(truth, wheels=((0, (0.0, 0.0)),), decisions=({'stamp': 0},), name='bag'):
        path = tmp_path / name
        with BagWriter(path) as bag:
            bag.topic('/sim/truth', ODOMETRY)
            bag.topic('/sim/wheel_speeds', JOINTS)
            bag.topic('/guidance/decision', STATUS)
            for stamp, pose, twist in truth:
                bag.write('/sim/truth', stamp, raw(odometry(stamp, pose, twist)))
            for stamp, speeds in wheels:
                bag.write('/sim/wheel_speeds', stamp, raw(joints(stamp, speeds)))
            for each in decisions:
                bag.write('/guidance/decision', each['stamp'], raw(decision(**each)))
        return path

    return write
