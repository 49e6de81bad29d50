"""Bags with damage of every kind: none may do more than be refused.

`python test/unit/bags/storage/fuzz.py --count 5000` reads and recovers that many mutated bags
in bounded memory and time, and prints what became of them.
"""

import argparse
import json
import random
import resource
import shutil
import signal
import struct
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from cmpsp_ros.bags import Bag, BagError, BagWriter, Form
from cmpsp_ros.bags.export import export
from cmpsp_ros.bags.recover import recover

sys.path.insert(0, str(Path(__file__).parents[3]))

import bag_messages as say

MEMORY = 1500 << 20
"""Address space a bag may take, libraries included [bytes]."""

DISK = 64 << 20
"""Largest file that recovery may write [bytes]."""

SECONDS = 10
"""Computing time a bag may take [s]; the process ends by SIGPROF when it takes more."""

FORMS = (
    Form(),
    Form(compressed=True),
    Form('sqlite3'),
    Form(split_duration=15),
    Form('sqlite3', split_duration=15),
)

EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 1 << 31, (1 << 31) - 1, (1 << 32) - 1, 1 << 40)
EXTREMES_64 = (*EXTREMES, 1 << 62, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)

TEXTS = ('&a [*a]', '- ' * 50, '[' * 5000, '!!python/object:os.system {}', '~', '-1', 'x' * 999)

OWN = MessageDefinition(
    MessageDefinitionFormat.MSG,
    'string[] names\nOther[] others\n'
    + '=' * 80
    + '\nMSG: my_msgs/Other\nfloat64[3] values\nstring text\n',
)


def messages():
    """One message of every kind that guidance knows, and one of a type nobody knows."""
    for topic, message in (
        ('/cmd_vel', say.twist(1.0, 2.0)),
        ('/guidance/decision', say.status('why', stamp=1, miss=0.25)),
        ('/guidance/predicted_path', say.path(1, [(1.0, 2.0)] * 3)),
    ):
        yield topic, message.__msgtype__, say.raw(message), None
    names = struct.pack('<III', 0x100, 1, 2) + b'a\0\0\0' + struct.pack('<I', 0)
    yield '/own', 'my_msgs/msg/Own', names, OWN


def whole_bag(path, form, damage=lambda raw: raw):
    """A sound bag, its messages damaged before they are written."""
    with BagWriter(path, form) as bag:
        chosen = list(messages())
        for topic, name, _, definition in chosen:
            bag.topic(topic, name, (), definition)
        for stamp in range(1, 30):
            topic, _, raw, _ = chosen[stamp % len(chosen)]
            bag.write(topic, stamp, damage(raw))
            if stamp % 10 == 0:
                bag.flush()
        bag.set_parameters('/guidance', {'final_time': 10.0})


def mutate(chance, data):
    """Damage bytes in one to four places."""
    data = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        if not data:
            break
        place = chance.randrange(len(data))
        kind = chance.randrange(8)
        if kind == 0:
            data[place] ^= 1 << chance.randrange(8)
        elif kind == 1:
            data[place] = chance.randrange(256)
        elif kind == 2:
            data[place : place + 4] = struct.pack('<I', chance.choice(EXTREMES) & 0xFFFFFFFF)
        elif kind == 3:
            data[place : place + 8] = struct.pack('<Q', chance.choice(EXTREMES_64))
        elif kind == 4:
            del data[place:]
        elif kind == 5:
            del data[place : place + chance.randint(1, 64)]
        elif kind == 6:
            piece = data[place : place + chance.randint(1, 4096)]
            data[place:place] = piece * chance.randint(1, 3)
        else:
            size = chance.randint(1, 512)
            data[place : place + size] = bytes(len(data[place : place + size]))
    return bytes(data)


def mutate_text(chance, text):
    """Damage a line of YAML."""
    lines = text.splitlines()
    place = chance.randrange(len(lines))
    key, colon, _ = lines[place].partition(':')
    lines[place] = f'{key}{colon} {chance.choice(TEXTS)}' if colon else chance.choice(TEXTS)
    return '\n'.join(lines) + '\n'


def damaged_bag(chance, sound, path):
    """A bag with damage somewhere: in its messages, its files, or its metadata."""
    where = chance.randrange(10)
    form = chance.choice(FORMS)
    if where == 0:
        whole_bag(path, form, lambda raw: raw[:4] + mutate(chance, raw[4:]))
        return
    shutil.copytree(sound[form], path)
    files = sorted(path.iterdir())
    if where == 1:
        metadata = path / 'metadata.yaml'
        metadata.write_text(mutate_text(chance, metadata.read_text()))
    elif where == 2:
        (path / 'metadata.yaml').write_bytes(mutate(chance, (path / 'metadata.yaml').read_bytes()))
    else:
        victim = chance.choice([each for each in files if each.suffix != '.yaml'])
        data = victim.read_bytes()
        if victim.suffix == '.mcap' and chance.random() < 0.2:
            # Without an index; the whole file is scanned.
            data = data[:-28] + bytes(20) + data[-8:]
        victim.write_bytes(mutate(chance, data))


def read_all(path):
    """Read every message of every topic; returns what became of it."""
    try:
        with Bag(path) as bag:
            refused = 0
            for topic in bag.topics:
                try:
                    for _ in bag.messages(topic):
                        pass
                except BagError as error:
                    check(error)
                    refused += 1
    except BagError as error:
        check(error)
        return 'refused'
    return 'partly read' if refused else 'read'


def check(error):
    """An error is one line, and memory was never at its end."""
    assert '\n' not in str(error), error
    assert not isinstance(error.__cause__, (MemoryError, AssertionError)), error


def attempt(work, *args):
    """Do what may be refused; returns whether it was not."""
    try:
        work(*args)
    except BagError as error:
        check(error)
        return False
    return True


def fuzz(count, seed, folder):
    """Try so many bags; returns what became of them, and the longest time of one [s]."""
    sound = {form: folder / f'sound_{number}' for number, form in enumerate(FORMS)}
    for form, path in sound.items():
        whole_bag(path, form)
        assert read_all(path) == 'read'
    outcomes, slowest = Counter(), 0.0
    for number in range(count):
        chance = random.Random(f'{seed} {number}')
        path = folder / 'bag'
        damaged_bag(chance, sound, path)
        begun = time.monotonic()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        try:
            outcomes[read_all(path)] += 1
            outcomes['recovered'] += attempt(recover, path, folder / 'whole')
            outcomes['exported'] += attempt(export, path, folder / 'tables')
            if (folder / 'whole').exists():
                outcome = read_all(folder / 'whole')
                assert outcome != 'refused', 'what was recovered is a bag'
                outcomes[f'{outcome} when recovered'] += 1
        except BaseException:
            print(f'bag {number} of seed {seed}', file=sys.stderr)
            raise
        signal.setitimer(signal.ITIMER_PROF, 0)
        slowest = max(slowest, time.monotonic() - begun)
        for each in ('bag', 'whole', 'tables'):
            shutil.rmtree(folder / each, ignore_errors=True)
        left = {each.name for each in folder.iterdir()} - {each.name for each in sound.values()}
        assert not left, left
    return dict(outcomes), slowest


def main():
    """Do it within the limits."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--count', type=int, default=300)
    parser.add_argument('--seed', default='1')
    args = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (DISK, DISK))
    with TemporaryDirectory() as folder:
        outcomes, slowest = fuzz(args.count, args.seed, Path(folder))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(json.dumps({'outcomes': outcomes, 'slowest': slowest, 'megabytes': memory}))


if __name__ == '__main__':
    main()
