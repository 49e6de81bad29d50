"""Every command on every kind of bag that it cannot use: one line that says why, and no files."""

import re
import shutil

import pytest
from commands import command
from recorded_drives import DECISIONS, dropping, setting, without

from cmpsp_ros.bags import Bag, BagError, BagWriter, Names
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.replay.replay import replay

COMMANDS = {
    'replay': ['replay', 'bag'],
    'what if': ['replay', 'bag', '--set', 'weights.road_center=30', '--output', 'new'],
    'audit': ['audit', 'bag', '--junit', 'new.xml'],
    'report': ['report', 'bag', '--output', 'new.html'],
    'export': ['export', 'bag', '--output', 'new'],
    'play': ['play', 'bag'],
    'recover': ['recover', 'bag', '--output', 'new'],
}
LAWS, DRIVES = ('replay', 'what if'), ('audit', 'report')
READERS = tuple(name for name in COMMANDS if name != 'recover')

SAYS = [
    (tuple(COMMANDS), 'absent', 'bag: no such bag'),
    (READERS, 'folder', r'not a bag: expected a metadata\.yaml in this folder'),
    (READERS, 'file', r'not a bag: expected a folder, or a file that ends in \.mcap or \.db3'),
    (('recover',), 'folder', r'not a bag: expected files that end in \.mcap or \.db3'),
    (('recover',), 'file', r'not a bag: expected files that end in \.mcap or \.db3'),
    (READERS, 'written', r'being written right now: expected a metadata\.yaml'),
    (('recover',), 'written', 'being written right now; stop the recorder first'),
    (READERS, 'cut off', 'the recording was cut off: .* `cmpsp recover bag` makes a whole bag'),
    (READERS, 'half', 'bag_0.mcap is without an index, .*; `cmpsp recover` makes one'),
    (LAWS, 'empty', 'no parameters of /guidance; there are those of no node'),
    (DRIVES, 'empty', r'found no parameters of a guidance node, wanted .* \(--params-file\)'),
    (('export',), 'empty', 'no topic that makes a table; there is no topic at all'),
    (('play',), 'empty', 'no message to play in any topic'),
    (('recover',), 'empty', 'no topic can be recovered: there is none'),
    (LAWS, 'silent', 'found 0 decisions of /guidance, wanted one that begins a run'),
    (DRIVES, 'silent', r'found no message in /odom, nor in any other, wanted a drive \(--odom\)'),
    (('play',), 'silent', 'no message to play in /cmd_vel, /guidance/decision, .*, /odom'),
    (LAWS, 'no parameters', 'no parameters of /guidance; there are those of no node'),
    (DRIVES, 'no parameters', r'found no parameters of a guidance node, wanted .*--params-file'),
    (LAWS, 'no odometry', 'no topic /odom; there is /cmd_vel, /guidance/decision, '),
    (DRIVES, 'no odometry', r'no topic /odom, wanted one of /cmd_vel, .* \(--odom\)'),
    (LAWS, 'no decisions', 'no topic /guidance/decision; there is /cmd_vel, '),
    (DRIVES, 'no commands', r'no topic /cmd_vel, wanted one of /guidance/.* \(--cmd-vel\)'),
    (LAWS, 'nan', 'no usable odometry: Odometry has a pose that is not finite'),
    (DRIVES, 'nan', '/odom, received at 17.* ns: Odometry has a pose that is not finite'),
    (LAWS, 'inf', 'no usable odometry: Odometry has a pose that is not finite'),
    (DRIVES, 'inf', '/odom, received at 17.* ns: Odometry has a pose that is not finite'),
    (LAWS, 'frame', r"Odometry is in frame 'map', wanted 'odom' \(frame_id\)"),
    (DRIVES, 'frame', r"Odometry is in frame 'map', wanted 'odom' \(frame_id\)"),
    (LAWS, 'key', r'parameters of /guidance: final_tim: found .* \(did you mean final_time\?\)'),
    (
        ('replay',),
        'older',
        r'found no solver\.candidates among the parameters of /guidance, wanted',
    ),
    (DRIVES, 'key', r'parameters of /guidance: final_tim: found .* \(did you mean final_time\?\)'),
]


@pytest.fixture
def make(drive, alter, tmp_path, monkeypatch):
    """Make a bad bag, `bag` in the working folder: `make('cut off')`."""
    monkeypatch.chdir(tmp_path)
    being_written = []

    def spoilt(change):
        def spoil(topic, _index, message):
            if topic == '/odom':
                change(message)
            return message

        replaced(alter(spoil))

    def replaced(copy):
        shutil.rmtree('bag')
        copy.rename('bag')

    def without(missing, *, messages=True):
        with Bag(tmp_path / 'bag') as whole, BagWriter(tmp_path / 'part') as part:
            for topic in sorted(whole.topics.keys() - {missing}):
                part.topic(topic, whole.topics[topic].msgtype)
                for stamp, raw in whole.raw(topic) if messages else ():
                    part.write(topic, stamp, raw)
            if not messages:
                part.set_parameters('/guidance', whole.parameters['/guidance'])
        replaced(tmp_path / 'part')

    def make(kind):
        bag = tmp_path / 'bag'
        with drive() as run:
            run.go(0.3)
        match kind:
            case 'absent':
                shutil.rmtree(bag)
            case 'folder':
                shutil.rmtree(bag)
                bag.mkdir()
            case 'file':
                shutil.rmtree(bag)
                bag.write_text('a note')
            case 'written':
                shutil.rmtree(bag)
                being_written.append(BagWriter(bag))
                being_written[0].flush()
            case 'cut off':
                (bag / 'metadata.yaml').unlink()
            case 'half':
                content = (bag / 'bag_0.mcap').read_bytes()
                (bag / 'bag_0.mcap').write_bytes(content[: len(content) // 2])
            case 'empty':
                shutil.rmtree(bag)
                BagWriter(bag).close()
            case 'silent':
                without('', messages=False)
            case 'no parameters':
                replaced(alter(parameters={}))
            case 'no odometry':
                without('/odom')
            case 'no decisions':
                without('/guidance/decision')
            case 'no commands':
                without('/cmd_vel')
            case 'nan' | 'inf':
                spoilt(lambda each: setattr(each.pose.pose.position, 'y', float(kind)))
            case 'frame':
                spoilt(lambda each: setattr(each.header, 'frame_id', 'map'))
            case 'older':
                with Bag(bag) as whole:
                    said = dict(whole.parameters['/guidance'])
                del said['solver.candidates']
                replaced(alter(parameters={'/guidance': said}))
            case 'key':
                replaced(alter(parameters={'/guidance': {'final_tim': 1.0}}))

    yield make
    for each in being_written:
        each.close()


def files(folder):
    return {each: each.read_bytes() for each in folder.rglob('*') if each.is_file()}


@pytest.mark.parametrize(
    ('commands', 'kind', 'reason'),
    [
        pytest.param(
            *each,
            id=f'{each[1]}-{each[0][0]}',
            marks=[pytest.mark.ros] if 'play' in each[0] else [],
        )
        for each in SAYS
    ],
)
def test_it_says_why_and_leaves_everything_as_it_is(make, tmp_path, commands, kind, reason):
    make(kind)
    before = files(tmp_path)
    for name in commands:
        done = command(*COMMANDS[name])
        assert done.exit_code == 2, (name, done.output, done.exception)
        assert re.match(f'bag: .*{reason}|{reason}', done.stderr), (name, done.stderr)
        assert len(done.stderr.splitlines()) == 1, name
        assert done.stdout == '', name
        assert files(tmp_path) == before, name


@pytest.mark.parametrize('kind', ['no decisions', 'no commands'])
def test_what_a_command_does_not_need_may_be_missing(make, kind):
    make(kind)
    needless = {'no decisions': ['audit', 'report', 'export'], 'no commands': ['replay', 'export']}
    for name in needless[kind]:
        done = command(*COMMANDS[name])
        # Without decisions an audit cannot judge them.
        assert done.exit_code in {0, 1, 3}, (name, done.output)
        assert done.stderr == '', name


@pytest.mark.parametrize('kind', ['cut off', 'half', 'no parameters', 'nan'])
def test_recover_takes_what_is_there(make, tmp_path, kind):
    make(kind)
    assert command(*COMMANDS['recover']).exit_code == 0
    with Bag(tmp_path / 'new') as new:
        assert new.topics


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


def as_text(source, topic, target):
    """A copy of a bag in which all messages of a topic are text."""
    kind = 'std_msgs/msg/String'
    raw = bytes(jazzy().serialize_cdr(jazzy().types[kind]('Well.'), kind))
    with Bag(source) as whole, BagWriter(target) as other:
        for name, there in whole.topics.items():
            other.topic(name, kind if name == topic else there.msgtype)
            for stamp, message in whole.raw(name):
                other.write(name, stamp, raw if name == topic else message)
    return target


@pytest.mark.parametrize('topic', ['/odom', '/cmd_vel', DECISIONS])
def test_a_topic_of_another_type_is_refused(short, tmp_path, topic):
    with pytest.raises(BagError, match=f'{topic}: found a message that is none of its type'):
        replay(as_text(short[0], topic, tmp_path / 'other'), NAMES)


@pytest.mark.parametrize('name', [*LAWS, *DRIVES])
def test_changes_of_parameters_of_another_type_are_refused(changed, bag, monkeypatch, name):
    as_text(bag, '/parameter_events', bag.with_name('other'))
    monkeypatch.chdir(bag.parent)
    verb, _, *options = COMMANDS[name]
    done = command(verb, 'other', *options)
    assert done.exit_code == 2, (done.output, done.exception)
    assert done.stderr == (
        'other: found std_msgs/msg/String in /parameter_events, wanted'
        ' rcl_interfaces/msg/ParameterEvent\n'
    )
