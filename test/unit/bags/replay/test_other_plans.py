"""A run beside another robot: replayed bit for bit, and audited, from its bag."""

from __future__ import annotations

import pytest
from recorded_drives import SECOND, TICK, Drive, altered, dropping, make, odometry

from cmpsp_ros.bags.audit import Sources, audit
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.messages import PATH
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.recording import Names
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.guidance.messages.peer_trajectories import PeerTrajectory
from cmpsp_ros.guidance.messages.tracks import Tracks

TOPIC, ODOM = '/r2/guidance/predicted_path', '/r2/odom'
NAMES = Names.under('/r1')
START, VELOCITY, RADIUS = (9.3, -4.8), (-0.45, -0.45), 0.3
AHEAD = 3 * SECOND


def path(plan, frame_id='odom'):
    """A plan as its robot publishes it."""

    def header(stamp):
        time = make('builtin_interfaces/msg/Time', *divmod(stamp, SECOND))
        return make('std_msgs/msg/Header', time, frame_id)

    level = make('geometry_msgs/msg/Quaternion', 0.0, 0.0, 0.0, 1.0)
    poses = [
        make(
            'geometry_msgs/msg/PoseStamped',
            header(stamp),
            make('geometry_msgs/msg/Pose', make('geometry_msgs/msg/Point', x, y, 0.0), level),
        )
        for stamp, (x, y) in zip(plan.stamps, plan.places, strict=True)
    ]
    return bytes(jazzy().serialize_cdr(make(PATH, header(plan.stamp), poses), PATH))


class Beside(Drive):
    """A drive of /r1 towards /r2, which tells of its plan at 10 Hz, a little late."""

    def __init__(self, folder, **parameters):
        others = {'others.namespaces': ['/r1', '/r2'], 'others.radius': RADIUS}
        super().__init__(folder, prefix='/r1', preset='moving', **others, **parameters)
        self.known, self.count, self.begun = Tracks(), 0, self.now
        self.bag.topic(TOPIC, PATH)
        self.bag.topic(ODOM, 'nav_msgs/msg/Odometry')

    def place(self, stamp):
        seconds = (stamp - self.begun) / SECOND
        return tuple(x + seconds * v for x, v in zip(START, VELOCITY, strict=True))

    def hear(self, stamp):
        self.bag.write(ODOM, self.now + 300, odometry(stamp, (*self.place(stamp), -2.3)))
        if self.count % 5 == 0:
            # Of three messages in a row one is in another frame, and one was never heard.
            stamps = (stamp, stamp + AHEAD)
            plan = PeerTrajectory('/r2', stamp, stamps, tuple(map(self.place, stamps)))
            self.bag.write(TOPIC, self.now + 500, path(plan, 'map'))
            self.bag.write(TOPIC, self.now + 600, path(plan))
            if self.count % 15:
                self.known.hear([plan])
        self.count += 1
        self.say(odometry(stamp, self.pose))
        if self.law.is_due(stamp):
            known = self.known.at(stamp, self.settings.moving_obstacles.timeout)
            self.publish(self.law.update(stamp, self.measured(), known))


@pytest.fixture(scope='module')
def passed(tmp_path_factory):
    folder = tmp_path_factory.mktemp('passed') / 'bag'
    with Beside(folder) as run:
        run.go(10.2)
    return folder, run.decisions


def test_replayed_bit_for_bit(passed):
    bag, decisions = passed
    assert sum(bool(each.tracks) for each in decisions) > 40
    outcome = replay(bag, NAMES)
    assert outcome.first is None, outcome.first
    assert outcome.decisions == len(decisions) == 51


def test_a_bag_without_the_plans_is_refused(passed, tmp_path):
    bag, _ = passed
    lacking = altered(bag, tmp_path / 'lacking', dropping(TOPIC))
    with pytest.raises(BagError, match=r'on the plan that /r2 made at .* wanted that in /r2/guid'):
        replay(lacking, NAMES)


def test_another_plan_is_noticed(passed, tmp_path):
    bag, _ = passed

    def change(topic, index, message):
        if topic == TOPIC and index > 20:
            message.poses[-1].pose.position.x += 0.5
        return message

    assert replay(altered(bag, tmp_path / 'moved', change), NAMES).differing > 0


def finding(bag):
    found = audit(bag, Sources(odom='/r1/odom'))
    return next(each for each in found if each.check == 'others')


def test_the_audit_keeps_it_clear(passed):
    found = finding(passed[0])
    assert found.outcome.name == 'PASSED', found
    assert 'm from robot /r2.' in found.sentence
    assert 0.0 < found.worst < 0.5


def test_the_audit_sees_a_collision(tmp_path):
    """The node hears nothing, and drives into the other robot."""
    folder = tmp_path / 'bag'
    with Beside(folder) as run:
        run.known.at = lambda *_: ()
        run.go(10.2)
    found = finding(folder)
    assert found.outcome.name == 'FAILED'
    assert 'cuts robot /r2 by' in found.sentence


def test_where_the_other_drove_must_be_in_the_bag(passed, tmp_path):
    bag, _ = passed
    with Bag(bag) as there:
        assert there.topics[ODOM].count == round(10.2 * SECOND) // TICK
    lacking = altered(bag, tmp_path / 'lacking', dropping(ODOM))
    assert finding(lacking).outcome.name == 'SKIPPED'
