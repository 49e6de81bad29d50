"""Bags made to crash, hang or exhaust whoever reads them."""

import json
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from bag_messages import HELLO, STATUS, STRING
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from cmpsp_ros.bags import Bag, BagError, BagWriter, Form
from cmpsp_ros.bags.recover import recover
from cmpsp_ros.bags.storage.limits import MAX_CHUNK, MAX_METADATA, MAX_TOPICS

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[3]
FRAME = b'\x28\xb5\x2f\xfd'


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'bag'


def make(path, form=None, raw=HELLO, msgtype=STRING, definition=None):
    with BagWriter(path, form) as bag:
        bag.topic('/a', msgtype, (), definition)
        for stamp in range(1, 4):
            bag.write('/a', stamp, raw)
    return path


def read(path):
    with Bag(path) as bag:
        return list(bag.messages('/a'))


def refused(path, reason):
    with pytest.raises(BagError, match=reason) as error:
        read(path)
    assert str(path) in str(error.value)
    assert '\n' not in str(error.value)


def edit_metadata(path, old, new):
    metadata = path / 'metadata.yaml'
    text = metadata.read_text()
    assert old in text
    metadata.write_text(text.replace(old, new))


def compressed(path, mode):
    """Say that a bag is compressed by zstd, by file or by message."""
    edit_metadata(path, "compression_mode: ''", f'compression_mode: {mode}')
    edit_metadata(path, "compression_format: ''", 'compression_format: zstd')


def test_random_damage(tmp_path, program):
    outcomes, _ = program(HERE / 'fuzz.py').fuzz(30, 'test', tmp_path)
    assert outcomes.keys() >= {'read', 'refused', 'partly read', 'recovered'}


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_more_random_damage_in_bounded_memory():
    """More of the same: `python test/unit/bags/storage/fuzz.py --count 5000`."""
    done = subprocess.run(
        [sys.executable, HERE / 'fuzz.py', '--count', '250', '--seed', 'test'],
        env={**os.environ, 'PYTHONPATH': str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    outcomes = json.loads(done.stdout)['outcomes']
    assert min(outcomes[each] for each in ('read', 'refused', 'partly read', 'recovered')) > 5


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a: &x [1]\nb: [*x, *x]', 'YAML with an alias'),
        ('a: &x {b: 1}\nc: {<<: *x}', 'YAML with an alias'),
        # PyYAML has a limit of its own from 6.0.4 on.
        ('[' * 100_000, 'nested more than|nesting depth'),
        ('- ' * 100, 'nested more than'),
        ('rosbag2_bagfile_information: !!python/object/apply:os.system [ls]', 'damaged'),
        ('rosbag2_bagfile_information: {a: ' + '9' * 100_000 + '}', 'damaged'),
        ('# ' + 'x' * MAX_METADATA, 'at most'),
        ('rosbag2_bagfile_information: [1]', 'has no rosbag2_bagfile_information'),
        ('\x00', 'not YAML'),
        ('', 'not a readable bag'),
        ('{', 'not a readable bag'),
        ('rosbag2_bagfile_information: {version: 9}', 'not a readable bag'),
    ],
)
def test_metadata(path, text, reason):
    make(path)
    (path / 'metadata.yaml').write_text(text)
    refused(path, reason)


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        ('  - bag_0.mcap', '  - bag_0.mcap\n  - bag_0.mcap', 'names a file twice'),
        ('  - bag_0.mcap', '  - ../../../etc/passwd', 'names passwd, which is not there'),
        ('  - bag_0.mcap', '  - ..', 'not a regular file'),
        ('relative_file_paths:', 'relative: 1\n  others:', 'names no files'),
        ('name: /a', 'name: 5', 'topic is a int, wanted a str'),
        ('message_count: 3\n', 'message_count: x\n', 'not a readable bag'),
        ("compression_mode: ''", 'compression_mode: file', 'not a readable bag'),
        ('cmpsp_ros.version: ', 'cmpsp_ros.version: [', 'not YAML'),
        ('cmpsp_ros.version: ', 'cmpsp_ros.version: !!int 4 #', 'wanted a str'),
        ("parameters: '{", "parameters: '{/guidance", 'not a readable bag'),
        ("parameters: '{", "parameters: '" + '[' * 100_000 + '{', 'not a readable bag'),
        ("parameters: '{", "parameters: '{" + '"a": 5 , "b":{', 'not a readable bag'),
    ],
)
def test_metadata_in_parts(path, old, new, reason):
    make(path)
    edit_metadata(path, old, new)
    refused(path, reason)


@pytest.mark.parametrize('name', ['metadata.yaml', 'bag_0.mcap'])
def test_pipe_is_not_waited_for(path, name):
    make(path)
    (path / name).unlink()
    os.mkfifo(path / name)
    refused(path, 'not a regular file')
    if name != 'metadata.yaml':
        with pytest.raises(BagError, match='not a regular file'):
            recover(path)


def test_chunks_of_zeros(path):
    zeros = b'\x00\x01\x00\x00' + struct.pack('<I', 40 << 20) + bytes(40 << 20)
    with BagWriter(path, Form(compressed=True)) as bag:
        bag.topic('/a', STRING)
        for stamp in range(8):
            bag.write('/a', stamp, zeros)
    assert next(path.glob('*.mcap')).stat().st_size < 100_000
    refused(path, r'chunks of \d+ bytes uncompressed, at most')
    assert recover(path).messages < 8


def test_chunk_larger_than_it_says(path):
    make(path, Form(compressed=True))
    file = next(path.glob('*.mcap'))
    data = file.read_bytes()
    begin = data.index(FRAME)
    chunk = zstd.decompress(data[begin : begin + int.from_bytes(data[begin - 8 : begin], 'little')])
    bomb = zstd.compress(chunk + bytes(1 << 28))
    size = int.from_bytes(data[begin - 8 : begin], 'little')
    assert len(bomb) > size, 'what follows would have to be moved back'
    # The chunk's own record only: its index still says what it was.
    record = data.index(b'\x06' + struct.pack('<Q', size + 40 + len('zstd')))
    file.write_bytes(
        data[: record + 1]
        + struct.pack('<Q', len(bomb) + 40 + len('zstd'))
        + data[record + 9 : begin - 8]
        + struct.pack('<Q', len(bomb))
        + bomb
        + data[begin + size :]
    )
    refused(path, 'bag')
    found = recover(path)
    assert found.messages == 0
    assert any('bytes uncompressed' in each for each in found.remarks)


def test_message_larger_than_any(path):
    make(path, raw=HELLO)
    file = next(path.glob('*.mcap'))
    data = bytearray(file.read_bytes())
    at = data.index(HELLO) - 22 - 8
    data[at : at + 8] = struct.pack('<Q', 1 << 62)
    file.write_bytes(data)
    refused(path, 'damaged in topic /a: Chunk checksum mismatch')
    chunk = data.index(b'\x06')
    data[chunk + 33 : chunk + 37] = bytes(4)
    file.write_bytes(data)
    refused(path, 'damaged in topic /a: Truncated record')
    # In the index it is there twice, compressed and not.
    size = bytes(data[chunk + 1 + 8 + 16 : chunk + 1 + 8 + 24])
    last = data.rindex(size + size) + 8
    data[last : last + 8] = struct.pack('<Q', MAX_CHUNK + 1)
    file.write_bytes(data)
    refused(path, f'chunk of {MAX_CHUNK + 1} bytes, at most')


@pytest.mark.parametrize('count', [3, 1 << 20, (1 << 31) - 1, (1 << 32) - 1])
@pytest.mark.parametrize('name', [STRING, STATUS])
def test_counts_in_messages(path, count, name):
    raw = b'\x00\x01\x00\x00' + (b'' if name == STRING else bytes(4)) + struct.pack('<I', count)
    refused(make(path, raw=raw, msgtype=name), 'message of /a at 1 ns cannot be read')


def test_many_topics(path):
    with BagWriter(path) as bag:
        for number in range(MAX_TOPICS + 1):
            bag.topic(f'/topic_{number}', STRING)
    refused(path, f'{MAX_TOPICS} ')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('string[99999999] x\n', 'arrays of more than'),
        ('Own[9999] x\nOwn[9999] y\n', 'arrays of more than'),
        ('Own x\n', 'cannot be read'),
        ('Other x\n', 'cannot be read'),
        ('float64 x\n' * 10_000, 'at most'),
        ('float64 x\n__import__("os").abort()\n', 'cannot be read'),
        ('int32 X=' + '9' * 10_000 + '\n', 'cannot be read'),
        ('(' * 10_000, 'cannot be read'),
    ],
)
def test_definitions(path, text, reason):
    definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
    refused(make(path, msgtype='my_msgs/msg/Own', definition=definition), reason)


def test_code_in_a_definition_is_a_name_and_a_default(path):
    text = 'float64 import os; os.abort()\n'
    definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
    make(path, msgtype='my_msgs/msg/Own', definition=definition, raw=HELLO[:4] + bytes(8))
    assert [each.import_ for _, each in read(path)] == [0.0] * 3


@pytest.mark.parametrize('name', ['my_msgs/msg/Own\nfloat64 x', 'class', '../msg/A', 'a/msg/1'])
def test_names_of_types(path, name):
    definition = MessageDefinition(MessageDefinitionFormat.MSG, 'float64 x\n')
    refused(make(path, msgtype=name, definition=definition), 'no definition of its type')


def test_definition_of_a_known_type_that_differs(path):
    definition = MessageDefinition(MessageDefinitionFormat.MSG, 'uint32 size\n')
    make(path, msgtype=STRING, definition=definition, raw=HELLO[:8])
    assert [each.size for _, each in read(path)] == [6, 6, 6]


@pytest.mark.parametrize(
    'script',
    [
        'ALTER TABLE messages RENAME TO m;'
        'CREATE VIEW messages AS WITH RECURSIVE r(id) AS (SELECT 1 UNION ALL SELECT id FROM r)'
        " SELECT id, 1 topic_id, 1 timestamp, x'00' data FROM r;",
        'CREATE TRIGGER t AFTER INSERT ON messages BEGIN SELECT 1; END;',
        'CREATE VIRTUAL TABLE v USING fts5(x);',
        'CREATE INDEX i ON messages (length(zeroblob(1000000000)));',
        'ALTER TABLE messages ADD COLUMN x GENERATED ALWAYS AS (zeroblob(1000000000));',
        'DROP TABLE messages;',
        "UPDATE topics SET offered_qos_profiles = '[&a [], *a]';",
        'UPDATE topics SET offered_qos_profiles = hex(zeroblob(2000000));',
        'UPDATE messages SET data = 5;',
        "UPDATE messages SET timestamp = 'x';",
    ],
)
def test_databases(path, script):
    make(path, Form('sqlite3'))
    database = sqlite3.connect(next(path.glob('*.db3')))
    database.executescript(script)
    database.close()
    refused(path, 'bag')
    try:
        recovered = recover(path)
    except BagError:
        pass
    else:
        Bag(recovered.path).close()


def test_a_value_larger_than_any_is_refused_at_once(path):
    make(path, Form('sqlite3'))
    with sqlite3.connect(next(path.glob('*.db3'))) as database:
        database.execute(f'UPDATE messages SET data = zeroblob({MAX_CHUNK + 1}) WHERE id = 1')
    database.close()
    with pytest.raises(BagError, match=rf'message of {MAX_CHUNK + 1} bytes .* at most {MAX_CHUNK}'):
        Bag(path)


def test_file_that_fills_the_disk(path, monkeypatch):
    make(path)
    compressed(path, 'FILE')
    file = path / 'bag_0.mcap'
    whole = file.read_bytes()
    file.write_bytes(zstd.compress(whole))
    assert len(read(path)) == 3
    monkeypatch.setattr('cmpsp_ros.bags.storage.limits.MAX_INFLATED_FILE', len(whole) - 1)
    refused(path, 'bytes uncompressed')


def test_messages_compressed_one_by_one(path):
    message = zstd.compress(HELLO)
    make(path, raw=message)
    compressed(path, 'MESSAGE')
    assert [each.data for _, each in read(path)] == ['hello'] * 3
    shutil.rmtree(path)
    make(path, raw=zstd.compress(bytes(MAX_CHUNK + 1)))
    compressed(path, 'MESSAGE')
    refused(path, f'more than {MAX_CHUNK} bytes uncompressed')
