"""Runs among obstacles that move: replayed bit for bit, and audited, from their bags."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from recorded_drives import SECOND, Drive, altered, dropping, make, odometry

from cmpsp_ros.bags.audit import audit
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.replay.recording import Names
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.guidance.messages.tracks import FLOATS, Track, Tracks

CLOUD, TOPIC = 'sensor_msgs/msg/PointCloud2', '/moving_obstacles'
NAMES = Names.under('')
ONCOMING = (9.3, -4.8, -0.45, -0.45, 0.3)


def cloud(tracks, frame_id='odom'):
    field = jazzy().types['sensor_msgs/msg/PointField']
    fields = [field(name, 8 * place, 8, 1) for place, name in enumerate(FLOATS)]
    points = [
        struct.pack('<5di', each.x, each.y, each.vx, each.vy, each.radius, each.id)
        for each in tracks
    ]
    time = make('builtin_interfaces/msg/Time', *divmod(tracks[0].stamp, SECOND))
    message = make(
        CLOUD,
        make('std_msgs/msg/Header', time, frame_id),
        1,
        len(tracks),
        [*fields, field('id', 40, 5, 1)],
        False,
        44,
        44 * len(tracks),
        np.frombuffer(b''.join(points), np.uint8),
        True,
    )
    return bytes(jazzy().serialize_cdr(message, CLOUD))


class Encounter(Drive):
    """A drive towards something that moves, which is told of at 10 Hz, a little late."""

    def __init__(self, folder, mover=ONCOMING, every=5, **parameters):
        super().__init__(folder, preset='moving', **parameters)
        self.tracks, self.mover, self.every, self.count = Tracks(), mover, every, 0
        self.begun = self.now
        self.bag.topic(TOPIC, CLOUD)

    def hear(self, stamp):
        if self.count % self.every == 0:
            # Of three messages in a row one is in another frame, and one was never heard.
            x, y, vx, vy, radius = self.mover
            since = (stamp - self.begun) / SECOND
            track = Track(5, stamp, radius, x + since * vx, y + since * vy, vx, vy)
            self.bag.write(TOPIC, self.now + 500, cloud([track], 'map'))
            self.bag.write(TOPIC, self.now + 600, cloud([track]))
            if self.count % (3 * self.every):
                self.tracks.hear([track])
        self.count += 1
        self.say(odometry(stamp, self.pose))
        if self.law.is_due(stamp):
            known = self.tracks.at(stamp, self.settings.moving_obstacles.timeout)
            self.publish(self.law.update(stamp, self.measured(), known))


@pytest.fixture(scope='module')
def met(tmp_path_factory):
    folder = tmp_path_factory.mktemp('met') / 'bag'
    with Encounter(folder) as run:
        run.go(10.2)
    return folder, run.decisions


def test_replayed_bit_for_bit(met):
    bag, decisions = met
    assert any(each.tracks for each in decisions)
    outcome = replay(bag, NAMES)
    assert outcome.first is None, outcome.first
    assert outcome.decisions == len(decisions) == 51


def test_a_bag_without_them_is_refused(met, tmp_path):
    bag, _ = met
    lacking = altered(bag, tmp_path / 'lacking', dropping(TOPIC))
    with pytest.raises(
        BagError, match=r'on obstacle 5 as it was seen at .* wanted that in /moving'
    ):
        replay(lacking, NAMES)


def test_another_place_is_noticed(met, tmp_path):
    bag, _ = met

    def change(topic, index, message):
        if topic == TOPIC and index > 60:
            data = struct.pack('<d', 9.7) + bytes(message.data[8:])
            message = replace(message, data=np.frombuffer(data, np.uint8))
        return message

    assert replay(altered(bag, tmp_path / 'moved', change), NAMES).differing > 0


def finding(bag):
    return next(each for each in audit(bag) if each.check == 'moving')


def test_the_audit_keeps_it_clear(met):
    found = finding(met[0])
    assert found.outcome.name == 'PASSED', found
    assert 'moving obstacle 5, at its predicted position' in found.sentence
    assert 0.0 < found.worst < 0.5


def test_the_audit_sees_a_collision(tmp_path):
    """The node listens to nothing, and drives into what is told of."""
    folder = tmp_path / 'bag'
    with Encounter(folder) as run:
        run.tracks.at = lambda *_: ()
        run.go(10.2)
    found = finding(folder)
    assert found.outcome.name == 'FAILED'
    assert 'cuts moving obstacle 5 by' in found.sentence


def test_what_drives_into_a_robot_that_stands_is_no_collision_of_the_robots(tmp_path):
    folder = tmp_path / 'bag'
    x, y = 0.0, -9.25
    with Encounter(folder, mover=(x + 0.6, y, -0.1, 0.0, 0.3)) as run:
        run.law.update = lambda stamp, *_: run.law.halt(stamp, 'Hold.')
        run.go(8.0)
    found = finding(folder)
    assert found.outcome.name == 'SKIPPED'
    assert found.sentence == 'The robot stands while anything moves.'
