"""Bags stay readable however the writing ends."""

import math
import os
import platform
import re
import resource
import struct
import subprocess
import sys
from array import array
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_messages import HELLO, LATCHED, STRING
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML

from cmpsp_ros.bags import Bag, BagError, BagWriter, Form, UnknownTypeError
from cmpsp_ros.bags.custom_data import PARAMETERS_KEY, SOFTWARE_KEY, VERSION_KEY
from cmpsp_ros.bags.recover import recover
from cmpsp_ros.bags.storage.common import UNFINISHED

REPOSITORY = Path(__file__).parents[3]


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'runs' / 'bag'


def information(path):
    text = (path / 'metadata.yaml').read_text()
    return YAML(typ='safe').load(text)['rosbag2_bagfile_information']


def stamps(path, topic='/a'):
    with Bag(path) as bag:
        return [stamp for stamp, _ in bag.raw(topic)]


def test_metadata(path):
    with BagWriter(path) as bag:
        bag.topic('/a', STRING, [LATCHED])
        bag.write('/a', 7, HELLO)
        assert bag.message_count == 1
        bag.set_custom({'key': 'ä: [\n'})
        bag.flush()
        assert (path / UNFINISHED).exists()
    assert not (path / UNFINISHED).exists()
    with Bag(path) as bag:
        assert bag.software['python'] == platform.python_version()
    found = information(path)
    assert found['version'] == 9
    assert found['storage_identifier'] == 'mcap'
    assert set(found['custom_data']) == {PARAMETERS_KEY, SOFTWARE_KEY, VERSION_KEY, 'key'}
    assert found['custom_data']['key'] == 'ä: [\n'
    (topic,) = found['topics_with_message_count']
    known = 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
    assert topic['topic_metadata']['type_description_hash'] == known
    (profile,) = topic['topic_metadata']['offered_qos_profiles']
    assert profile['reliability'] == 'reliable'
    assert profile['durability'] == 'transient_local'
    assert profile['lifespan'] == {'sec': 9223372036, 'nsec': 854775807}
    with Reader(path) as reader:
        assert [raw for _, _, raw in reader.messages()] == [HELLO]


def test_parameters_read_back_bit_for_bit(path):
    numbers = [0.1 + 0.2, 5e-324, -0.0, 1.7976931348623157e308, math.inf, -math.inf, 51.0]
    values = {f'x{k}': each for k, each in enumerate(numbers)}
    values |= {'nan': math.nan, 'list': numbers, 'array': array('d', numbers)}
    values |= {'numpy': np.float64(1 / 3), 'int': 2**62, 'flag': True, 'text': 'ä "\n', 'empty': []}
    with BagWriter(path) as bag:
        bag.set_parameters('/a', {'old': 1})
        bag.set_parameters('/a', values)
        bag.set_parameters('/b', {})
    with Bag(path) as bag:
        read = bag.parameters
    assert set(read) == {'/a', '/b'}
    assert read['/a'].keys() == values.keys()
    for name, value in values.items():
        found = read['/a'][name]
        if isinstance(value, (list, array)):
            assert struct.pack(f'{len(value)}d', *found) == struct.pack(f'{len(value)}d', *value)
        elif isinstance(value, float):
            assert type(found) is float
            assert struct.pack('d', found) == struct.pack('d', value)
        else:
            assert found == value
            assert type(found) is type(value)


def test_parameter_of_another_kind(path):
    with BagWriter(path) as bag, pytest.raises(BagError, match='parameter x of /a is a dict'):
        bag.set_parameters('/a', {'x': {}})


@pytest.mark.parametrize('kind', [KeyboardInterrupt, ZeroDivisionError, SystemExit])
def test_bag_is_whole_when_the_body_raises(path, kind):
    def body():
        with BagWriter(path) as bag:
            bag.topic('/a', STRING)
            bag.write('/a', 1, HELLO)
            raise kind

    with pytest.raises(kind):
        body()
    assert stamps(path) == [1]


def test_close_twice_and_use_after(path):
    bag = BagWriter(path)
    bag.topic('/a', STRING)
    bag.close()
    bag.close()
    for use in (
        lambda: bag.write('/a', 1, HELLO),
        lambda: bag.topic('/b', STRING),
        lambda: bag.set_parameters('/a', {}),
        bag.flush,
    ):
        with pytest.raises(BagError, match='is closed'):
            use()
    assert stamps(path) == []


def test_path_that_cannot_be_made(tmp_path):
    (tmp_path / 'file').touch()
    for path, reason in (
        ('file', 'exists already'),
        ('.', 'exists'),
        ('file/bag', 'cannot create'),
    ):
        with pytest.raises(BagError, match=reason):
            BagWriter(tmp_path / path)


def test_topics(path):
    with BagWriter(path) as bag:
        with pytest.raises(UnknownTypeError, match=r'topic /x left out: .* type my_msgs/msg/Own'):
            bag.topic('/x', 'my_msgs/msg/Own')
        bag.topic('/a', STRING)
        with pytest.raises(BagError, match='topic /a has been added already'):
            bag.topic('/a', STRING)
        with pytest.raises(BagError, match='write to topic /x'):
            bag.write('/x', 1, HELLO)
        bag.write('/a', 1, HELLO)
    assert stamps(path) == [1]


FILL_DISK = """
import resource, sys
from pathlib import Path
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.storage.common import Form
from cmpsp_ros.bags.writer import BagWriter

bag = BagWriter(Path(sys.argv[1]), Form(sys.argv[4]))
bag.topic('/a', 'std_msgs/msg/String')
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    for stamp in range(100_000):
        bag.write('/a', stamp, bytes.fromhex(sys.argv[3]))
        if stamp % 100 == 99:
            bag.flush()
except BagError as error:
    print(error)
try:
    bag.close()
except BagError as error:
    print(error)
"""


def fill_disk(path, limit, storage='mcap'):
    """Write until the operating system refuses, in a process that may write `limit` bytes."""
    done = subprocess.run(
        [sys.executable, '-c', FILL_DISK, path, str(limit), HELLO.hex(), storage],
        env={**os.environ, 'PYTHONPATH': str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    assert done.stderr == ''
    return done.stdout.splitlines()


# Steps of 2 kB, so that the end comes in the head, the messages and the index of a chunk.
@pytest.mark.parametrize('limit', range(50_000, 58_000, 2000))
def test_full_disk_leaves_a_whole_bag(path, limit):
    if resource.getrlimit(resource.RLIMIT_FSIZE)[0] != resource.RLIM_INFINITY:
        pytest.skip('file sizes are limited already')
    refused, closed = fill_disk(path, limit)
    assert refused.startswith(f'{path}: cannot write to the bag: ')
    assert re.search(r'closed without its last \d+ messages: ', closed)
    found = stamps(path)
    assert len(found) > 300
    assert found == list(range(len(found)))
    with Bag(path) as bag:
        assert bag.topics['/a'].count == len(found)


def test_no_room_even_for_the_index(path):
    refused, closed = fill_disk(path, 200)
    assert 'cannot write' in refused
    assert closed.startswith(f'{path}: cut off, without index and metadata: ')
    with pytest.raises(BagError, match='cut off'):
        Bag(path)


FORMS = [Form(), Form(compressed=True), Form('sqlite3')]


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('split', [{'split_size': 5000}, {'split_duration': 100}])
def test_split(path, form, split):
    with BagWriter(path, replace(form, **split)) as bag:
        bag.topic('/a', STRING, [LATCHED])
        for stamp in range(1, 401):
            bag.write('/a', stamp, HELLO)
            if stamp == 200:
                bag.topic('/late', STRING)
        assert bag.message_count == 400
    found = information(path)
    names = found['relative_file_paths']
    assert len(names) == 4 or 'split_size' in split
    assert len(names) > 2
    suffix = {'mcap': 'mcap', 'sqlite3': 'db3'}[form.storage]
    assert names == [f'bag_{number}.{suffix}' for number in range(len(names))]
    assert [each['path'] for each in found['files']] == names
    assert sum(each['message_count'] for each in found['files']) == found['message_count'] == 400
    assert found['starting_time']['nanoseconds_since_epoch'] == 1
    assert found['duration']['nanoseconds'] == 399
    assert sorted(each.name for each in path.iterdir()) == sorted([*names, 'metadata.yaml'])
    assert stamps(path) == list(range(1, 401))
    assert stamps(path, '/late') == []
    with AnyReader([path]) as reader:
        assert reader.message_count == 400
    for each in names:
        assert stamps(path / each)


def test_compression(path, tmp_path):
    for name, form in (('plain', Form()), ('small', Form(compressed=True))):
        with BagWriter(tmp_path / name, form) as bag:
            bag.topic('/a', STRING)
            for stamp in range(1000):
                bag.write('/a', stamp, HELLO)
    plain, small = (next((tmp_path / each).glob('*.mcap')) for each in ('plain', 'small'))
    assert small.stat().st_size < plain.stat().st_size / 3
    assert stamps(tmp_path / 'small') == stamps(tmp_path / 'plain') == list(range(1000))
    with pytest.raises(BagError, match='only mcap can be compressed, not sqlite3'):
        BagWriter(path, Form('sqlite3', compressed=True))
    assert not path.exists()


def test_full_disk_of_a_database(path):
    refused, closed = fill_disk(path, 200_000, 'sqlite3')
    assert 'cannot write to the bag' in refused
    assert re.search('closed without its last|cut off', closed)
    bag = path
    if 'cut off' in closed:
        bag = recover(path).path
    found = stamps(bag)
    assert len(found) > 500
    assert found == list(range(len(found)))
