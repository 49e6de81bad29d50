"""Messages of mcap files in order of time, in bounded memory."""

import struct
from binascii import crc32

import pytest
from bag_messages import HELLO, STRING

from cmpsp_ros.bags import Bag, BagError, BagWriter, Form
from cmpsp_ros.bags.recover import recover
from cmpsp_ros.bags.storage.mcap import CHUNK, MAGIC, content, read_chunk, records


def write(path, chunks):
    """A bag with these chunks of topics and stamps."""
    with BagWriter(path) as bag:
        for topic in ('/a', '/b'):
            bag.topic(topic, STRING)
        for chunk in chunks:
            for topic, stamp in chunk:
                bag.write(topic, stamp, HELLO)
            bag.flush()
    return path


def record(opcode, body):
    return struct.pack('<BQ', opcode, len(body)) + body


def text(value):
    return struct.pack('<I', len(value)) + value.encode()


def without_chunks(stamps):
    """An mcap file with its messages one after the other, as rosbag2's `fastwrite` makes them."""
    schema = record(
        3, struct.pack('<H', 1) + text(STRING) + text('ros2msg') + text('string data\n')
    )
    channel = record(4, struct.pack('<HH', 1, 1) + text('/a') + text('cdr') + text(''))
    messages = b''.join(
        record(5, struct.pack('<HIQQ', 1, 0, stamp, stamp) + HELLO) for stamp in stamps
    )
    data = MAGIC + record(1, text('ros2') + text('')) + schema + channel + messages
    data += record(15, bytes(4))
    statistics = struct.pack('<QHIIIIQQ', len(stamps), 1, 1, 0, 0, 0, min(stamps), max(stamps))
    statistics += struct.pack('<IHQ', 10, 1, len(stamps))
    summary = schema + channel + record(11, statistics)
    return data + summary + record(2, struct.pack('<QQI', len(data), 0, 0)) + MAGIC


def test_chunks_that_overlap(tmp_path):
    chunks = [
        [('/a', 5), ('/b', 30), ('/a', 20)],
        [('/b', 1), ('/a', 20), ('/a', 10)],
        [('/a', 5), ('/a', 40)],
    ]
    with Bag(write(tmp_path / 'bag', chunks)) as bag:
        assert [stamp for stamp, _ in bag.messages('/a')] == [5, 5, 10, 20, 20, 40]
        found = [(topic, stamp) for topic, stamp, _ in bag.together(['/b', '/a'])]
    assert found == [
        *(('/b', 1), ('/a', 5), ('/a', 5), ('/a', 10)),
        *(('/a', 20), ('/a', 20), ('/b', 30), ('/a', 40)),
    ]


def test_messages_of_one_stamp_stay_in_the_order_of_writing(tmp_path):
    order = [('/b', 7), ('/a', 7), ('/a', 7), ('/b', 7), ('/a', 7)]
    with Bag(write(tmp_path / 'bag', [[each] for each in order])) as bag:
        assert [(topic, stamp) for topic, stamp, _ in bag.together(['/a', '/b'])] == order


def test_not_all_at_once(tmp_path, monkeypatch):
    apart = [[('/a', 10 * number + k) for k in range(5)] for number in range(10)]
    monkeypatch.setattr('cmpsp_ros.bags.storage.limits.MAX_HELD', 1_000)
    with Bag(write(tmp_path / 'apart', apart)) as bag:
        assert len(list(bag.raw('/a'))) == 50
    over = [[('/a', number), ('/a', 1000)] for number in range(1, 20)]
    with pytest.raises(BagError, match=r'not a readable bag: more than \d+ bytes .* overlap'):
        Bag(write(tmp_path / 'over', over))


def test_without_chunks(tmp_path):
    path = tmp_path / 'fast.mcap'
    path.write_bytes(without_chunks([3, 5, 5, 9]))
    with Bag(path) as bag:
        assert bag.topics['/a'].count == 4
        assert [stamp for stamp, _ in bag.messages('/a')] == [3, 5, 5, 9]
    path.write_bytes(without_chunks([3, 5, 4]))
    with Bag(path) as bag, pytest.raises(BagError, match='not in timestamp order'):
        list(bag.messages('/a'))


def test_without_index(tmp_path):
    file = tmp_path / 'file.mcap'
    whole = without_chunks([1])
    file.write_bytes(whole[:-28] + bytes(20) + MAGIC)
    with Bag(file) as bag:
        assert [stamp for stamp, _ in bag.messages('/a')] == [1]
    file.write_bytes(whole[:-28])
    with pytest.raises(BagError, match=r'without an index.*`cmpsp recover` makes one'):
        Bag(file)


@pytest.mark.parametrize('number', [1 << 41, (1 << 40) + 1])
def test_index_that_lies(tmp_path, number):
    path = write(tmp_path / 'bag', [[('/a', 1 << 40), ('/b', 1 << 41)]])
    file = next(path.glob('*.mcap'))
    data, told = file.read_bytes(), struct.pack('<Q', 1 << 40)
    later = data.rindex(told, 0, data.rindex(b'rosbag2'))
    data = data[:later] + struct.pack('<Q', number) + data[later + 8 :]
    file.write_bytes(data)
    with Bag(path) as bag, pytest.raises(BagError, match='found 0 messages, wanted the 1'):
        list(bag.messages('/a'))
    chunk = data.index(told)
    file.write_bytes(data[:chunk] + struct.pack('<Q', number) + data[chunk + 8 :])
    with Bag(path) as bag, pytest.raises(BagError, match='found 0 messages, wanted the 1'):
        list(bag.messages('/a'))


@pytest.mark.parametrize('compressed', [False, True])
def test_checksums(tmp_path, compressed):
    """Chunks and index carry theirs, and a flipped bit is noticed."""
    path = tmp_path / 'bag'
    with BagWriter(path, Form(compressed=compressed)) as bag:
        bag.topic('/a', STRING)
        for stamp in (1, 2):
            bag.write('/a', stamp, HELLO)
            bag.flush()
    file = next(path.glob('*.mcap'))
    data = file.read_bytes()
    with file.open('rb') as opened:
        found = list(records(opened, len(MAGIC), len(data) - len(MAGIC)))
        chunks = [
            read_chunk(content(opened, each, len(data))) for each in found if each.opcode == CHUNK
        ]
    assert len(chunks) == 2
    assert all(head.checksum == crc32(inner) != 0 for head, inner in chunks)
    index, _, checksum = struct.unpack('<QQI', data[found[-1].body : found[-1].end])
    assert checksum == crc32(data[index : found[-1].end - 4])
    if not compressed:
        at = data.rindex(HELLO)
        file.write_bytes(data[: at + 8] + b'j' + data[at + 9 :])
        with Bag(path) as bag, pytest.raises(BagError, match='checksum mismatch'):
            list(bag.messages('/a'))
        remarks = recover(path, tmp_path / 'new').remarks
        assert any('is not what it was when it was written' in each for each in remarks)
