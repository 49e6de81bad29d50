"""One drive of real nodes in real time, and all that is made of its bag afterwards."""

import csv
import json
import re
import sys

import pytest

from cmpsp_ros.bags import Bag, BagWriter, Names
from cmpsp_ros.bags.definitions import jazzy

pytestmark = pytest.mark.integration

NAMES = Names.under('')
COMMAND = [sys.executable, '-m', 'cmpsp_ros.cli']
CHARTS = {'path', 'levels', 'controls', 'clearance', 'position', 'steps', 'histogram'}
WRONG = 20


@pytest.fixture
def cmpsp(spawn):
    """Run a command to its end: `cmpsp('replay', bag)`."""

    def run(*arguments):
        process = spawn([*COMMAND, *arguments])
        return process, process.wait()

    return run


def with_one_wrong_command(source, target):
    """A copy of a bag in which one command turns the robot the other way."""
    with Bag(source) as bag, BagWriter(target) as new:
        for topic, there in bag.topics.items():
            new.topic(topic, there.msgtype, there.qos_profiles)
            for index, (stamp, raw) in enumerate(bag.raw(topic)):
                kept = raw
                if topic == NAMES.cmd_vel and index == WRONG:
                    twist = jazzy().deserialize_cdr(raw, there.msgtype)
                    twist.angular.z = 1.0 - twist.angular.z
                    kept = bytes(jazzy().serialize_cdr(twist, there.msgtype))
                new.write(topic, stamp, kept)
    return target


# The drive is in real time. With a clock commands are queued until the recorder has them; without
# one the newest replaces the last, which a busy machine may not have recorded. Nor does the robot
# stop when that machine makes odometry late.
PATIENT = ['--set', 'publish_clock=true', '--set', 'odom_timeout=10.0']


def test_a_drive_is_replayed_audited_reported_and_exported(cmpsp, verdicts, tmp_path):
    bag = tmp_path / 'run' / 'bag'
    demo, code = cmpsp('demo', 'case3', '--output', bag.parent, *PATIENT)
    assert code == 0, demo.stderr
    with Bag(bag) as opened:
        counts = {topic: there.count for topic, there in opened.topics.items()}
    decisions = counts[NAMES.decision]
    assert decisions > 50

    again, code = cmpsp('replay', bag)
    assert code == 0, again.stdout + again.stderr
    assert again.stdout.splitlines()[0] == f'identical: {decisions} decisions'
    assert f'{decisions} commands' in again.stdout

    audit, code = cmpsp('audit', bag, '--junit', tmp_path / 'audit.xml')
    assert code == 0, audit.stdout + audit.stderr
    said = verdicts(tmp_path / 'audit.xml')
    assert 'failure' not in said.values()
    for check in ('road', 'obstacles', 'wheel_limits', 'as_decided', 'obeyed', 'reasons'):
        assert said[check] == 'passed'

    report, code = cmpsp('report', bag, '--output', tmp_path / 'drive.html')
    assert code == 0, report.stderr
    page = (tmp_path / 'drive.html').read_text(encoding='utf-8')
    (told,) = re.findall(r'(?s)<script[^>]* id="data">(.*?)</script>', page)
    data = json.loads(told)
    assert data['figures'].keys() == CHARTS
    assert len(data['bags'][0]['x']) > 400
    assert 'Audit clean' in page
    assert (tmp_path / 'drive.png').read_bytes().startswith(b'\x89PNG\r\n\x1a\n')

    export, code = cmpsp('export', bag, '--output', tmp_path / 'tables')
    assert code == 0, export.stderr
    rows = {}
    for path in (tmp_path / 'tables').glob('*.csv'):
        with path.open(newline='', encoding='utf-8') as file:
            rows[path.stem] = len(list(csv.DictReader(file)))
    # The simulator says where the robot really is as odometry, too.
    assert rows['odometry'] == counts[NAMES.odom] + counts['/sim/truth']
    assert rows['commands'] == counts[NAMES.cmd_vel]
    assert rows['decisions'] == decisions

    wrong = with_one_wrong_command(bag, tmp_path / 'wrong')
    again, code = cmpsp('replay', wrong)
    assert code == 1, again.stdout + again.stderr
    assert f'decision {WRONG + 1} (stamp ' in again.stdout
    assert 'command.angular.z' in again.stdout
    audit, code = cmpsp('audit', wrong, '--junit', tmp_path / 'wrong.xml')
    assert code == 1, audit.stdout + audit.stderr
    assert verdicts(tmp_path / 'wrong.xml')['as_decided'] == 'failure'
