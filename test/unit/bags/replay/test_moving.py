"""Moving obstacles and goals under way: replayed at the same control step, and audited."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from bag_messages import SECOND, cloud, odometry, path
from recorded_drives import TICK, Drive, altered, dropping, editing, moving

from cmpsp_ros.bags import Bag, BagError, Names
from cmpsp_ros.bags.audit import CheckOutcome, Sources, audit
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.guidance import Observation
from cmpsp_ros.guidance.messages import PeerTrajectory, Track, Tracks

OTHERS_ODOM = '/r2/odom'
ONCOMING, RADIUS = (9.3, -4.8, -0.45, -0.45), 0.3
AHEAD = 3 * SECOND


class Encounter(Drive):
    """A drive towards something that moves, which is published at 10 Hz, a little late."""

    check, prefix, topic = 'moving', '', '/moving_obstacles'
    name, published = 'moving obstacle 5', r'on obstacle 5 as it was seen at .* wanted that in /mov'

    def __init__(self, folder, mover=ONCOMING, **parameters):
        super().__init__(folder, prefix=self.prefix, preset='moving', **parameters)
        self.known, self.mover, self.count, self.begun = Tracks(), mover, 0, self.now

    def place(self, stamp):
        x, y, vx, vy = self.mover
        seconds = (stamp - self.begun) / SECOND
        return x + seconds * vx, y + seconds * vy

    def seen(self, stamp):
        """Track of a moving obstacle, and the message with it in a frame."""
        track = Track(5, stamp, RADIUS, *self.place(stamp), *self.mover[2:])
        point = (5, track.x, track.y, track.vx, track.vy, track.radius)
        return track, lambda frame_id: cloud(stamp, [point], frame_id)

    def hear(self, stamp):
        if self.count % 5 == 0:
            # Of three messages in a row one is in another frame, and one was never heard.
            seen, message = self.seen(stamp)
            for late, frame_id in ((500, 'map'), (600, 'odom')):
                self.records.append((self.topic, self.now + late, message(frame_id)))
            if self.count % 15:
                self.known.add([seen])
        self.count += 1
        self.say(odometry(stamp, self.pose))
        if self.law.is_due(stamp):
            known = self.known.at(stamp, self.settings.moving_obstacles.timeout)
            self.publish(self.law.step(Observation(stamp, self.measured(), known)))


class Beside(Encounter):
    """The same of /r1 towards /r2, which publishes its plan."""

    check, prefix, topic = 'others', '/r1', '/r2/guidance/predicted_path'
    name, published = 'robot /r2', 'on the plan that /r2 made at .* wanted that in /r2/guid'

    def __init__(self, folder):
        others = {'others.namespaces': ['/r1', '/r2'], 'others.radius': RADIUS}
        super().__init__(folder, **others)

    def seen(self, stamp):
        stamps = (stamp, stamp + AHEAD)
        plan = PeerTrajectory('/r2', stamp, stamps, tuple(map(self.place, stamps)))
        return plan, lambda frame_id: path(stamp, plan.places, frame_id, stamps)

    def hear(self, stamp):
        place = odometry(stamp, (*self.place(stamp), -2.3))
        self.records.append((OTHERS_ODOM, self.now + 300, place))
        super().hear(stamp)


@pytest.fixture(scope='module', params=[Encounter, Beside])
def met(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp('met') / 'bag'
    with request.param(folder) as run:
        run.go(10.2)
    return request.param, folder, run.decisions


def finding(bag, kind):
    findings = audit(bag, Sources(odom=f'{kind.prefix}/odom'))
    return next(each for each in findings if each.check == kind.check)


def test_replayed_bit_for_bit(met):
    kind, bag, decisions = met
    assert sum(bool(each.tracks) for each in decisions) > 20
    outcome = replay(bag, Names.under(kind.prefix))
    assert outcome.first is None, outcome.first
    assert outcome.decisions == len(decisions) == 51


@pytest.mark.parametrize('aside', [-1.0, 1.0])
def test_after_time_has_jumped_back_it_is_elsewhere_at_the_same_instants(tmp_path, aside):
    bag, (x, *rest) = tmp_path / 'bag', ONCOMING
    with Encounter(bag) as run:
        run.go(2.5)
        run.law.reset()
        run.behind, run.known = 2 * SECOND, Tracks()
        run.mover = x + aside, *rest
        run.go(2.5)
    used = [track.key for each in run.decisions for track in each.tracks]
    assert len(used) > len(set(used)) > 5
    assert replay(bag, Names.under('')).differences == 0


def test_a_bag_without_them_is_refused(met, tmp_path):
    kind, bag, _ = met
    lacking = altered(bag, tmp_path / 'lacking', dropping(kind.topic))
    with pytest.raises(BagError, match=kind.published):
        replay(lacking, Names.under(kind.prefix))


def test_another_place_is_noticed(met, tmp_path):
    kind, bag, _ = met

    def move(message):
        if kind is Beside:
            return moving('poses.-1.pose.position.x', 0.5)(message)
        data = struct.pack('<d', 9.7) + bytes(message.data[8:])
        return replace(message, data=np.frombuffer(data, np.uint8))

    changed = altered(bag, tmp_path / 'moved', editing(kind.topic, move, *range(40, 200)))
    assert replay(changed, Names.under(kind.prefix)).differing > 0


def without_refused(bag, path):
    """The same bag without the obstacles in another frame, of which no audit can judge."""
    return altered(bag, path, dropping(Encounter.topic, *range(0, 1000, 2)))


def test_the_audit_keeps_it_clear(met, tmp_path):
    kind, bag, _ = met
    found = finding(without_refused(bag, tmp_path / 'usable'), kind)
    assert found.outcome.name == 'PASSED', found
    assert f'm from {kind.name}' in found.sentence
    assert 0.0 < found.worst < 0.5


@pytest.mark.parametrize('kind', [Encounter, Beside])
def test_the_audit_sees_a_collision(tmp_path, kind):
    """The node hears nothing, and drives into what it is not told of."""
    folder = tmp_path / 'bag'
    with kind(folder) as run:
        run.known.at = lambda *_: ()
        run.go(10.2)
    found = finding(folder, kind)
    assert found.outcome.name == 'FAILED'
    assert f'cuts {kind.name} by' in found.sentence


def test_what_drives_into_a_robot_that_stands_is_no_collision_of_the_robots(tmp_path):
    folder = tmp_path / 'bag'
    with Encounter(folder, mover=(0.6, -9.25, -0.1, 0.0)) as run:
        stops = []
        run.law.step = lambda seen: stops.append(run.law.halt(seen.stamp, 'Hold.')) or stops[-1]
        run.law.after_step = lambda: stops[-1]
        run.go(8.0)
    assert finding(folder, Encounter).outcome.name == 'NOT_JUDGED'
    found = finding(without_refused(folder, tmp_path / 'usable'), Encounter)
    assert found.outcome.name == 'SKIPPED'
    assert found.sentence == 'The robot stands while anything moves.'


def test_where_the_other_drove_must_be_in_the_bag(tmp_path):
    with Beside(tmp_path / 'bag') as run:
        run.go(2.0)
    with Bag(tmp_path / 'bag') as there:
        assert there.topics[OTHERS_ODOM].count == 2 * SECOND // TICK
    lacking = altered(tmp_path / 'bag', tmp_path / 'lacking', dropping(OTHERS_ODOM))
    assert finding(lacking, Beside).outcome.name == 'NOT_JUDGED'


NAMES = Names.under('')
ALONG = {'x': 7.0, 'y': -7.0, 'heading': math.pi / 4.0}


def goal_finding(path, check):
    return next(each for each in audit(path) if each.check == check)


@pytest.fixture
def told(drive, bag):
    """A drive with goals: before the start, refused ones, two that count, one of later, a reset."""
    with drive() as run:
        run.tell(**ALONG, heard=False)
        run.go(1.0)
        run.tell(0.0, 0.0, 0.0)
        run.tell(**ALONG, frame_id='map')
        run.tell(math.nan, 0.0, 0.0)
        run.go(0.5)
        run.tell(**ALONG)
        run.go(1.1)
        run.tell(9.5, -3.0, 1.2, stamp=run.now + 400_000_000)
        run.go(12.0)
        run.tell(**ALONG, heard=False)
        run.activate()
        run.pose = np.array([0.0, -9.25, 0.0])
        run.go(1.0)
        run.tell(**ALONG)
        run.go(8.0)
    return run.decisions


def test_a_replay_is_told_the_same(told, bag):
    assert [each.goals_received for each in told if each.goals_received] != []
    assert {each.goal.name for each in told} == {'', 'goal_pose'}
    assert any(each.finished and not each.missed for each in told)
    outcome = replay(bag, NAMES)
    assert str(outcome).startswith(f'identical: {len(told)} decisions')


def test_a_goal_that_is_not_in_the_bag_is_missed(told, alter):
    with pytest.raises(BagError, match='wanted all of them on goal_pose'):
        replay(alter(dropping('/goal_pose', 5)), NAMES)


def test_another_goal_makes_another_drive(told, alter):
    moved = alter(editing('/goal_pose', moving('pose.position.x', 0.01), 4))
    assert replay(moved, NAMES).differing > 0


def test_goals_that_were_told_are_audited(told, bag):
    found = goal_finding(bag, 'goal')
    assert found.outcome is CheckOutcome.PASSED
    assert found.worst < 1e-3
    assert 'It is the worst of 2 goals.' in found.sentence
