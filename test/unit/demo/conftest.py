"""Bags of runs that never happened."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from cmpsp_ros.bags.writer import BagWriter

STATUS, PATH = 'diagnostic_msgs/msg/DiagnosticStatus', 'nav_msgs/msg/Path'
ODOMETRY, JOINTS = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/JointState'


class Messages:
    """Serialised messages from few numbers."""

    def __init__(self):
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.types = self.store.types

    def raw(self, message, name):
        return bytes(self.store.serialize_cdr(message, name))

    def header(self, stamp):
        time = self.types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9))
        return self.types['std_msgs/msg/Header'](time, 'odom')

    def odometry(self, stamp, pose, twist):
        types, vector = self.types, self.types['geometry_msgs/msg/Vector3']
        x, y, heading = map(float, pose)
        turn = (0.0, 0.0, math.sin(heading / 2.0), math.cos(heading / 2.0))
        placed = types['geometry_msgs/msg/Pose'](
            types['geometry_msgs/msg/Point'](x, y, 0.0),
            types['geometry_msgs/msg/Quaternion'](*turn),
        )
        speed, rate = map(float, twist)
        moving = types['geometry_msgs/msg/Twist'](vector(speed, 0.0, 0.0), vector(0.0, 0.0, rate))
        unknown = np.zeros(36)
        message = types[ODOMETRY](
            self.header(stamp),
            'base_link',
            types['geometry_msgs/msg/PoseWithCovariance'](placed, unknown),
            types['geometry_msgs/msg/TwistWithCovariance'](moving, unknown),
        )
        return self.raw(message, ODOMETRY)

    def joints(self, stamp, speeds):
        none = np.zeros(0)
        names = ['right', 'left']
        message = self.types[JOINTS](self.header(stamp), names, none, np.array(speeds), none)
        return self.raw(message, JOINTS)

    def decision(self, stamp, rung='nominal', finished=False, step_ms=None, **more):
        wheels = {'wheel_speed_right': 45.0, 'wheel_speed_left': 44.0}
        told = {'stamp': stamp, 'step': 0, 'rung': rung, 'finished': str(finished).lower()}
        values = {**told, **wheels, **more}
        if step_ms is not None:
            values['step_ms'] = repr(step_ms)
        pair = self.types['diagnostic_msgs/msg/KeyValue']
        pairs = [pair(key, str(value)) for key, value in values.items()]
        return self.raw(self.types[STATUS](0, 'decision', f'It is {rung}.', '', pairs), STATUS)


@pytest.fixture(scope='session')
def messages():
    return Messages()


@pytest.fixture
def write_bag(tmp_path, messages):
    """Write a bag of `truth` (stamp, pose, twist), `wheels` (stamp, speeds) and `decisions`."""

    def write(truth, wheels=((0, (0.0, 0.0)),), decisions=({'stamp': 0},), name='bag'):
        path = tmp_path / name
        with BagWriter(path) as bag:
            bag.topic('/sim/truth', ODOMETRY)
            bag.topic('/sim/wheel_speeds', JOINTS)
            bag.topic('/guidance/decision', STATUS)
            for stamp, pose, twist in truth:
                bag.write('/sim/truth', stamp, messages.odometry(stamp, pose, twist))
            for stamp, speeds in wheels:
                bag.write('/sim/wheel_speeds', stamp, messages.joints(stamp, speeds))
            for each in decisions:
                bag.write('/guidance/decision', each['stamp'], messages.decision(**each))
        return path

    return write
