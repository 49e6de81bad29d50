"""The page in a real browser, where there is one."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from bag_messages import SECOND

from cmpsp_ros.bags.report import write_report

NAMES = ('chromium', 'chromium-headless-shell', 'google-chrome', 'chrome', 'chromium-browser')
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)

pytestmark = pytest.mark.skipif(BROWSER is None, reason=f'no browser: none of {", ".join(NAMES)}')


@pytest.fixture
def open_page(tmp_path):
    """Open a page at a time; what the browser makes of it, and what it complains about."""

    def opened(page, seconds):
        done = subprocess.run(
            [
                BROWSER,
                '--headless',
                '--no-sandbox',
                '--disable-gpu',
                f'--user-data-dir={tmp_path / "profile"}',
                '--virtual-time-budget=20000',
                '--enable-logging=stderr',
                '--dump-dom',
                f'{page.as_uri()}#t={seconds}',
            ],
            capture_output=True,
            text=True,
            check=True,
            timeout=100,
        )
        return done.stdout, [line for line in done.stderr.splitlines() if 'CONSOLE' in line]

    return opened


def points(dom, trace):
    """Points of the markers of a trace in the chart of the path."""
    chart = dom[dom.index('id="path"') : dom.index('class="slider"')]
    traces = re.findall(r'<g class="trace scatter [^"]*".*?</g></g>', chart)
    assert traces
    return chart.count('class="point"')


def test_it_renders_without_complaint_and_moves_with_its_slider(drive, tmp_path, open_page):
    page, _ = write_report([drive.write(tmp_path / 'bag')], tmp_path / 'report.html')
    early, complaints = open_page(page, 1.0)
    assert complaints == []
    assert 'data-ready="true"' in early
    assert early.count('class="main-svg"') >= 7
    late, complaints = open_page(page, 8.0)
    assert complaints == []
    assert '>1.00 s</output>' in early
    assert '>8.00 s</output>' in late
    assert 'The plan meets every constraint.' in late
    # The nearer the goal, the fewer points has the plan.
    assert points(early, 'plan') - points(late, 'plan') == 35


@pytest.mark.slow
def test_it_shows_what_was_seen_by_then(drive, tmp_path, open_page):
    first = drive.decisions[0].stamp
    seen = np.zeros((40, 40), np.int8)
    drive.sightings = [(first + 2 * SECOND, seen), (first + 6 * SECOND, seen + 100)]
    page, _ = write_report([drive.write(tmp_path / 'bag')], tmp_path / 'report.html')

    pictures = []
    for seconds in (1.0, 4.0, 8.0):
        dom, complaints = open_page(page, seconds)
        assert complaints == []
        pictures.append(re.findall(r'<image [^>]*href="(data:image/png[^"]*)"', dom))

    assert [len(each) for each in pictures] == [0, 1, 1]
    assert pictures[1] != pictures[2]


@pytest.mark.slow
def test_each_course_has_a_panel_in_which_its_robot_moves(drive, tmp_path, open_page):
    other = drive.copy()
    other.parameters['obstacles.b.center'] = [10.0, -2.5]
    bags = []
    for name, each in (('one', drive), ('two', other)):
        each.parameters['robot.radius'] = 0.05
        bags.append(each.write(tmp_path / name))
    page, _ = write_report(bags, tmp_path / 'report.html')

    def noses(seconds):
        """Lines from the centre of each robot to its front, and other strokes of two points."""
        dom, complaints = open_page(page, seconds)
        assert complaints == []
        chart = dom[dom.index('id="path"') : dom.index('class="slider"')]
        assert {'subplot xy', 'subplot x2y2'} <= set(re.findall(r'class="(subplot \w+)"', chart))
        lines = re.findall(r'class="js-line" d="([^"]*)"', chart)
        return {line for line in lines if line.count('L') == 1}

    early, late = noses(2.0), noses(8.0)
    # One robot in each panel goes with the slider; those at start and end stay.
    assert len(early & late) == 4
    assert len(early - late) == len(late - early) == 2


def test_texts_of_a_bag_do_not_run(hostile, tmp_path, open_page):
    page, _ = write_report([hostile.write(tmp_path / 'bag')], tmp_path / 'report.html')
    dom, complaints = open_page(page, 3.0)
    assert complaints == []
    assert 'data-ready="true"' in dom
    assert re.search(r'<title>(.*?)</title>', dom)[1].startswith('Guidance report: ')
    assert '<img' not in dom
