"""The page by its structure: complete, self-contained, and deaf to what is in a bag."""

import base64
import gzip
import hashlib
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from bag_messages import SECOND

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.report import write_report
from cmpsp_ros.bags.report.view import labels

CHARTS = {'path', 'levels', 'controls', 'clearance', 'position', 'steps', 'histogram'}


class Page(HTMLParser):
    """Page as a browser would show it, as far as it matters here."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.policy, self.words = set(), [], '', []
        self.handlers, self.scripts, self.rows = [], [], 0
        self._script = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.ids.add(attrs.get('id'))
        self.links += [value for key, value in attrs.items() if key in {'src', 'href', 'action'}]
        self.handlers += [key for key in attrs if key.startswith('on')]
        self.rows += tag == 'tr'
        if attrs.get('http-equiv') == 'Content-Security-Policy':
            self.policy = attrs['content']
        if tag == 'script':
            self._script = attrs.get('type', 'text/javascript')
            self.scripts.append((self._script, attrs.get('id'), ''))

    def handle_endtag(self, tag):
        if tag == 'script':
            self._script = None

    def handle_data(self, data):
        if self._script is None:
            self.words.append(data)
        else:
            kind, name, text = self.scripts[-1]
            self.scripts[-1] = (kind, name, text + data)

    def script(self, name):
        (text,) = (text for _, each, text in self.scripts if each == name)
        return text

    @property
    def data(self):
        return json.loads(self.script('data'))

    @property
    def text(self):
        return ' '.join(' '.join(self.words).split())


def digest(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@pytest.fixture
def report(tmp_path):
    """Write a report of drives."""

    def write(*drives):
        bags = [each.write(tmp_path / f'run{k}' / 'bag') for k, each in enumerate(drives)]
        page, picture = write_report(bags, tmp_path / 'report.html')
        assert picture.read_bytes().startswith(b'\x89PNG')
        return page

    return write


@pytest.fixture(scope='module')
def plain(whole_drive, tmp_path_factory):
    """The report of a whole drive, as it should be; its text."""
    bag = whole_drive.write(tmp_path_factory.mktemp('plain') / 'run0' / 'bag')
    page, _ = write_report([bag], bag.parents[1] / 'report.html')
    return page.read_text(encoding='utf-8')


def test_it_is_complete_and_small_and_needs_nothing_else(plain):
    assert len(plain) < 5_000_000
    page = Page(plain)
    assert page.ids >= CHARTS | {'time', 'now', 'said', 'play', 'data', 'library'}
    assert page.data['figures'].keys() == CHARTS
    assert page.links == []
    assert page.handlers == []
    for said in ('Audit clean', 'run0', 'miss at the final time', 'weights.road_center', '1/m^2'):
        assert said in page.text


def test_nothing_runs_but_the_scripts_that_the_policy_names(plain):
    page = Page(plain)
    library = gzip.decompress(base64.b64decode(page.script('library'))).decode()
    assert 'plotly.js v' in library[:200]
    runs = [text for kind, _, text in page.scripts if kind == 'text/javascript']
    assert len(runs) == 1
    rules = dict(rule.strip().split(' ', 1) for rule in page.policy.split(';'))
    assert rules['default-src'] == "'none'"
    assert set(rules['script-src'].split()) == {digest(library), digest(runs[0])}


def test_texts_of_a_bag_stay_texts(report, hostile):
    raw = report(hostile).read_text(encoding='utf-8')
    page = Page(raw)
    assert [kind for kind, _, _ in page.scripts] == [
        'application/json',
        'application/octet-stream',
        'text/javascript',
    ]
    assert page.links == page.handlers == []
    assert '<img' not in raw
    attack = hostile.frame_id
    assert attack in page.text
    assert attack in page.data['bags'][0]['decisions'][0][2]
    # plotly knows some HTML of its own, which no text may reach as such.
    for figure in page.data['figures'].values():
        shown = json.dumps(figure['data'])
        assert '<img' not in shown
        assert '<script' not in shown


def test_charts_hold_what_was_driven(plain, drive):
    data = Page(plain).data
    (bag,) = data['bags']
    assert bag['t'][0] == 0.0
    assert bag['t'][-1] == pytest.approx(10.4)
    assert (bag['x'][0], bag['y'][0]) == pytest.approx(drive.odometry[0].pose[:2])
    assert len(bag['plans']) == 50
    assert bag['plans'][5]['x'][:2] == pytest.approx(drive.decisions[5].plan.poses[:2, 0].tolist())
    traces = {each['name']: each for each in data['figures']['path']['data']}
    assert traces['driven']['x'] == bag['x']
    assert (traces['plan']['x'], traces['goal']['x']) == ([], [10.0])
    assert (traces['moving']['x'], traces['driven to']['x'], bag['moving']) == ([], [], [])
    assert bag['goals'] == [[0.0, 10.0, 0.0, 'the goal']]
    right, left, *_ = data['figures']['controls']['data']
    assert right['y'] == pytest.approx([each.wheel_speeds[0] for each in drive.decisions])
    assert left['line']['dash'] == 'dash'
    limits = [each['text'] for each in data['figures']['controls']['layout']['annotations']]
    assert limits == ['limit 51 rad/s']
    (deadline,) = data['figures']['steps']['layout']['annotations']
    assert deadline['text'] == 'deadline 200 ms'
    assert sum(data['figures']['histogram']['data'][0]['y']) == len(drive.decisions)
    bands = {each['name']: each for each in data['figures']['levels']['data']}
    assert bands.keys() == {'nominal', 'arrived'}
    assert sum(bands['nominal']['x']) == pytest.approx(10.0)
    road, obstacles = data['figures']['clearance']['data']
    assert min(obstacles['y']) == pytest.approx(0.0634, abs=1e-3)
    assert min(road['y']) == pytest.approx(0.235, abs=1e-2)


def test_missed_goals_and_deadlines_are_counted_and_marked(report, drive):
    drive.decisions = [each._replace(missed=each.finished) for each in drive.decisions]
    told = {'step': 10.0, 'odometry_to_command': 250.0}
    drive.decisions[5] = drive.decisions[5]._replace(late=0.21, phases={'step': 210.0})
    drive.decisions[9] = drive.decisions[9]._replace(phases=told)
    text = report(drive).read_text(encoding='utf-8')
    figures = Page(text).data['figures']
    assert {each['name'] for each in figures['levels']['data']} == {'nominal', 'stop'}
    *_, missed = figures['steps']['data']
    assert (missed['name'], missed['mode']) == ('deadline missed', 'markers')
    assert (missed['x'], missed['y']) == ([1.0, 1.8], [210.0, 250.0])
    assert '<td>deadlines missed</td><td>2 of ' in text


def test_several_bags_on_one_course_are_laid_over_each_other(report, drive):
    other = drive.copy()
    other.parameters['safety.margin'] = 0.1
    text = report(drive, other).read_text(encoding='utf-8')
    page = Page(text)
    assert [each['label'] for each in page.data['bags']] == ['run0', 'run1']
    traces = page.data['figures']['path']['data']
    driven = [each for each in traces if each['name'] in {'run0', 'run1'}]
    assert [each['xaxis'] for each in driven] == ['x', 'x']
    assert driven[0]['line']['color'] != driven[1]['line']['color']
    assert [each['name'] for each in traces].count('obstacle') == 1
    (differs,) = re.findall(r'<tr class="differs"><td>([^<]*)', text)
    assert differs == 'safety.margin'
    assert 'Audit found something' in page.text
    assert '1 failed, 9 skipped' in page.text
    assert 'Audit clean' in page.text


def test_an_audit_that_lacks_data_is_not_called_clean(report, drive):
    page = Page(report(drive.until(4.1)).read_text(encoding='utf-8'))
    assert 'Audit not complete: data are missing' in page.text
    assert '2 not judged' in page.text
    assert 'The recording ends 5.9 s before the final time.' in page.text
    assert 'Audit clean' not in page.text


def test_a_bag_of_another_robot_has_a_report_too(drive, tmp_path):
    from cmpsp_ros.bags.audit import Sources

    bag = drive.without_node().write(tmp_path / 'foreign')
    page, _ = write_report([bag], tmp_path / 'report.html', Sources(params_file='case3'))
    data = Page(page.read_text(encoding='utf-8')).data
    assert data['bags'][0]['plans'] == data['bags'][0]['decisions'] == []
    assert data['figures']['levels']['data'] == []


def test_a_report_that_cannot_be_written_is_named(drive, tmp_path):
    bag = drive.write(tmp_path / 'bag')
    with pytest.raises(BagError, match=r'report\.html: cannot be written'):
        write_report([bag], tmp_path / 'no' / 'report.html')


def test_bags_are_named_by_what_tells_them_apart(tmp_path):
    assert labels([tmp_path / 'a' / 'bag', tmp_path / 'b']) == ['a', 'b']
    assert labels([tmp_path / 'a', tmp_path / 'c' / 'a']) == ['a (1)', 'a (2)']
    (tmp_path / '2026' / 'bag').mkdir(parents=True)
    (tmp_path / 'latest').symlink_to(tmp_path / '2026')
    assert labels([tmp_path / 'latest' / 'bag', tmp_path / 'latest']) == ['2026 (1)', '2026 (2)']


def test_of_what_was_seen_some_grids_are_kept_and_one_that_is_none_is_not(drive, report):
    first, seen = drive.decisions[0].stamp, np.zeros((40, 40), np.int8)
    drive.sightings = [(first + k * SECOND // 100, seen + k % 100) for k in range(500)]
    drive.sightings.append((first + 8 * SECOND, np.zeros((0, 40), np.int8)))

    (bag,) = Page(report(drive).read_text()).data['bags']

    assert 150 < len(bag['grids']) <= 200
    assert [bag['grids'][0][each] for each in ('t', 'x', 'y')] == [0.0, 0.0, 2.0]
    assert sorted(each['t'] for each in bag['grids']) == [each['t'] for each in bag['grids']]
    assert bag['grids'][-1]['t'] < 5.0
