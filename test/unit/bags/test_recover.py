"""Recovery makes a whole bag of a broken one, and leaves the broken one as it is."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from bag_messages import HELLO, LATCHED, STRING
from rosbags.highlevel import AnyReader
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from cmpsp_ros.bags import Bag, BagError, BagWriter, Form
from cmpsp_ros.bags.recover import recover

REPOSITORY = Path(__file__).parents[3]
OWN = MessageDefinition(MessageDefinitionFormat.MSG, 'float64 value\n')
FORMS = [Form(), Form(compressed=True), Form('sqlite3'), Form(split_size=900)]


def write(bag, stamps):
    for stamp in stamps:
        bag.write('/a', stamp, HELLO)


def make(path, form):
    """A sound bag of 60 messages, in several chunks."""
    with BagWriter(path, form) as bag:
        bag.topic('/a', STRING, [LATCHED])
        bag.topic('/own', 'my_msgs/msg/Own', (), OWN)
        bag.set_parameters('/guidance', {'gain': 0.1})
        for begin in (1, 21, 41):
            write(bag, range(begin, begin + 20))
            bag.flush()
    return path


def stamps(path, topic='/a'):
    with Bag(path) as bag:
        return [stamp for stamp, _ in bag.messages(topic)]


def content(folder):
    return {each.name: each.read_bytes() for each in folder.iterdir()}


KILLED = """
import os, signal, sys
from pathlib import Path
from cmpsp_ros.bags.storage.common import Form
from cmpsp_ros.bags.writer import BagWriter

bag = BagWriter(Path(sys.argv[1]), eval(sys.argv[2]))
bag.topic('/a', 'std_msgs/msg/String')
bag.set_parameters('/guidance', {'gain': 0.1})
for stamp in range(1, 101):
    bag.write('/a', stamp, bytes.fromhex(sys.argv[3]))
    if stamp == 80:
        bag.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize('form', FORMS)
def test_killed(tmp_path, form):
    bag = tmp_path / 'bag'
    killed = subprocess.run(
        [sys.executable, '-c', KILLED, bag, repr(form), HELLO.hex()],
        env={**os.environ, 'PYTHONPATH': str(REPOSITORY)},
        check=False,
        timeout=100,
    )
    assert killed.returncode == -signal.SIGKILL
    with pytest.raises(BagError, match=f'the recording was cut off: .*`cmpsp recover {bag}`'):
        Bag(bag)
    before = content(bag)
    found = recover(bag)
    assert found.path == tmp_path / 'bag_recovered'
    assert found.messages >= 80
    assert stamps(found.path) == list(range(1, found.messages + 1))
    assert content(bag) == before
    with Bag(found.path) as recovered, AnyReader([found.path]) as reader:
        assert recovered.parameters == {'/guidance': {'gain': 0.1}}
        assert recovered.version
        assert recovered.software['numpy']
        assert reader.message_count == found.messages


@pytest.mark.parametrize('form', FORMS)
def test_sound_bag_is_copied_with_everything(tmp_path, form):
    found = recover(make(tmp_path / 'bag', form), tmp_path / 'new')
    assert (found.messages, found.topics, found.remarks) == (60, 2, ())
    with Bag(tmp_path / 'bag') as before, Bag(tmp_path / 'new') as after:
        assert after.topics == before.topics
        assert after.topics['/a'].qos_profiles == (LATCHED,)
        assert (after.parameters, after.start, after.end) == (before.parameters, 1, 60)
        assert list(after.raw('/a')) == list(before.raw('/a'))


@pytest.mark.parametrize(('form', 'step'), [(FORMS[0], 107), (FORMS[1], 107), (FORMS[2], 2039)])
def test_cut_anywhere(tmp_path, form, step):
    (file,) = [each for each in make(tmp_path / 'bag', form).iterdir() if each.suffix != '.yaml']
    whole = file.read_bytes()
    counts = []
    for length in range(0, len(whole), step):
        cut = tmp_path / f'cut{file.suffix}'
        cut.write_bytes(whole[:length])
        try:
            found = recover(cut)
        except BagError:
            assert not (tmp_path / 'cut_recovered').exists()
            counts.append(0)
        else:
            counts.append(found.messages)
            assert found.remarks or found.messages == 60
            assert stamps(found.path) == list(range(1, found.messages + 1))
            shutil.rmtree(found.path)
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] >= 40
    assert len(set(counts)) > 10 or form != FORMS[0], 'whole messages of a cut chunk are kept'


def test_damaged_chunk_costs_no_other(tmp_path):
    bag = make(tmp_path / 'bag', Form(compressed=True))
    (file,) = bag.glob('*.mcap')
    data = bytearray(file.read_bytes())
    second = data.index(b'\x28\xb5\x2f\xfd', data.index(b'\x28\xb5\x2f\xfd') + 1)
    data[second : second + 4] = b'oops'
    file.write_bytes(data)
    found = recover(bag)
    assert stamps(found.path) == [*range(1, 21), *range(41, 61)]
    assert any('left out a record at byte' in each for each in found.remarks)


def test_metadata_of_no_use(tmp_path):
    bag = make(tmp_path / 'bag', Form())
    (bag / 'metadata.yaml').write_text('rosbag2_bagfile_information: [')
    found = recover(bag)
    assert found.messages == 60
    assert any('metadata.yaml: left out' in each for each in found.remarks)
    with Bag(found.path) as recovered:
        assert recovered.parameters == {}


def test_split_files_stay_in_order(tmp_path):
    with BagWriter(tmp_path / 'bag', Form(split_duration=1)) as bag:
        bag.topic('/a', STRING)
        write(bag, range(1, 13))
    assert len(list((tmp_path / 'bag').glob('*.mcap'))) == 12
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    found = recover(tmp_path / 'bag')
    with AnyReader([found.path]) as reader:
        assert [stamp for _, stamp, _ in reader.messages()] == list(range(1, 13))


def test_nothing_to_recover_leaves_nothing(tmp_path):
    (tmp_path / 'text.mcap').write_text('no bag')
    with pytest.raises(BagError, match=r'no topic can be recovered.*not an mcap file'):
        recover(tmp_path / 'text.mcap')
    assert [each.name for each in tmp_path.iterdir()] == ['text.mcap']
