"""A bag that cannot be replayed is refused, by its name."""

import pytest
from recorded_drives import DECISIONS, dropping, setting, without

from cmpsp_ros.bags import Bag, BagError, BagWriter, Names
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.replay.replay import replay

NAMES = Names.under('')


def without_key(bag, key):
    with Bag(bag) as there:
        values = there.parameters['/guidance']
    return {'/guidance': {name: value for name, value in values.items() if name != key}}


@pytest.fixture
def changed(drive):
    """A drive in which a weight is changed under way."""
    with drive() as run:
        run.go(0.7)
        run.change(weights__road_center=20.0)
        run.go(0.7)


def test_a_value_that_nobody_knows_is_not_guessed(changed, bag, alter):
    copy = alter(parameters=without_key(bag, 'weights.road_center'))
    with pytest.raises(BagError, match=r'change of weights\.road_center of /guidance at .* before'):
        replay(copy, NAMES)


def test_a_value_that_nobody_needs_to_know_is_not_missed(drive, bag, alter):
    with drive() as run:
        run.change(weights__road_center=20.0)
        run.go(0.7)
    copy = alter(parameters=without_key(bag, 'weights.road_center'))
    assert replay(copy, NAMES).differences == 0


@pytest.mark.parametrize('key', ['halted', 'run', 'revision'])
def test_a_bag_that_does_not_say_what_the_law_received_is_refused(changed, alter, key):
    with pytest.raises(BagError, match=f'found a decision without {key}'):
        replay(alter(without(key)), NAMES)


def test_a_live_change_that_was_not_recorded_is_refused(changed, alter):
    with pytest.raises(BagError, match='live change 1 of the parameters of /guidance'):
        replay(alter(dropping('/parameter_events')), NAMES)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (without('step'), 'without step, wanted one of this package'),
        (setting(0, stamp='soon'), "found stamp 'soon' in a decision, wanted a number"),
        (setting(1, run='x'), "found run 'x'"),
        (setting(1, revision='9' * 5000), 'found revision'),
        (setting(1, revision=str(10**18)), 'wanted that change in /parameter_events'),
        (dropping(DECISIONS, 0), 'found 2 decisions of /guidance, wanted one that begins'),
    ],
    ids=['no step', 'stamp', 'run', 'long', 'large', 'the middle only'],
)
def test_messages_that_cannot_be_replayed(replayed, change, reason):
    with pytest.raises(BagError, match=reason):
        replayed(change)


@pytest.mark.parametrize('topic', ['/odom', '/cmd_vel', DECISIONS])
def test_a_topic_of_another_type_is_refused(short, tmp_path, topic):
    kind = 'std_msgs/msg/String'
    raw = bytes(jazzy().serialize_cdr(jazzy().types[kind]('Well.'), kind))
    with Bag(short[0]) as whole, BagWriter(tmp_path / 'other') as other:
        for name, there in whole.topics.items():
            other.topic(name, kind if name == topic else there.msgtype)
            for stamp, message in whole.raw(name):
                other.write(name, stamp, raw if name == topic else message)
    with pytest.raises(BagError, match=f'{topic}: found a message that is none of its type'):
        replay(tmp_path / 'other', NAMES)
