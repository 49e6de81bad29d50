"""Targets, tables, pictures, JSON and the page."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.common import BenchError
from benchmarks.over_dds.latency import Latency
from benchmarks.report import check_output, content, page, write
from benchmarks.tables import tables

# What they share takes long to make.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group('bench_results')]


@pytest.fixture
def with_latency(results):
    own = np.linspace(1.0, 2.0, 120)
    first = np.arange(len(own)) == 0
    found = Latency(3, own + 0.5, own, first, np.diff(own), 0.002, np.array([1.5]), 200.0, 201.0)
    return replace(results, latency=found, order=replace(results.order, latency=True))


def test_a_folder_has_data_pictures_and_a_page(with_latency, tmp_path):
    write(with_latency, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        'bench.json', 'performance.md', 'horizons.png', 'steps.png', 'tails.png', 'latency.png',
    }  # fmt: skip
    for path in tmp_path.glob('*.png'):
        assert path.read_bytes().startswith(b'\x89PNG')
    read = json.loads((tmp_path / 'bench.json').read_text())
    assert read.keys() == content(with_latency).keys()
    latency = with_latency.latency
    assert read['latency']['total'] == latency.total.tolist()
    assert latency.rest.median == pytest.approx(0.5)
    assert read['latency']['resident_end'] == 201.0


def test_a_file_has_the_data_alone(results, tmp_path):
    path = tmp_path / 'results.json'
    check_output(path)
    write(results, path)
    assert [each.name for each in tmp_path.iterdir()] == ['results.json']
    read = json.loads(path.read_text())
    assert read['latency'] is None
    assert read['comparison']['timed'][0]['name'] == 'condensed + daqp'
    assert read['command'] == 'cmpsp bench case3 --runs 2 --tail 10 --peers'
    (tail,) = (each for each in read['tails'] if each['name'] == 'riccati active set')
    assert len(tail['times']) == len(tail['again']) == 12
    (jackal,) = (each for each in read['robots'] if each['name'] == 'jackal')
    assert np.shape(jackal['times'])[1:] == np.shape(jackal['work'])
    assert [each['steps'] for each in read['long_horizons']['found']] == [25, 50]
    assert [each['count'] for each in read['plans']] == [1, 2, 4, 8]
    titles = [each.title for each in tables(results)]
    assert [each['title'] for each in read['tables']] == titles
    assert [each['states'] for each in read['general']] == [3, 6, 12]
    assert {'holds', 'found', 'at_most', 'what'} == read['targets'][0].keys()
    assert {'processor', 'cores', 'kernel', 'Python', 'numba'} <= read['machine'].keys()


def test_the_page_links_what_is_there_and_executes_nothing(with_latency, tmp_path):
    write(with_latency, tmp_path)
    text = page(with_latency)
    assert (tmp_path / 'performance.md').read_text() == text
    assert 'cmpsp bench case3 --runs 2 --tail 10 --peers --latency' in text
    assert set(re.findall(r'^```(\w*)$', text, re.MULTILINE)) == {'sh', ''}
    links = re.findall(r'\]\(([^)]+)\)', text)
    assert links
    assert all((tmp_path / link).exists() for link in links)
    for table in re.findall(r'(?:^\|.*\n)+', text, re.MULTILINE):
        assert len({line.count('|') for line in table.splitlines()}) == 1


def test_every_method_is_in_the_tables(results):
    found = {table.title: table for table in tables(results)}
    names = [each.name for each in results.comparison.timed]
    for title in ('Closed loops of the methods', 'First step over horizons [µs]'):
        assert [row[0] for row in found[title].rows] == names
    titles = list(found)
    assert titles[:2] == ['Targets', 'Robots on long horizons [ms]']
    assert titles.index('One plan over long horizons') < titles.index('Closed loops of the methods')
    left_out = [row[0] for row in found['Not compared'].rows]
    assert set(left_out) == {
        *results.comparison.left_out, *results.missing, *results.long_horizons.missing,
    }  # fmt: skip


@pytest.mark.parametrize('name', ['there.json', '', 'there.json/folder', 'there.json/file.json'])
def test_output_that_cannot_be_used(tmp_path, name):
    (tmp_path / 'there.json').write_text('{}')
    with pytest.raises(BenchError, match=re.escape(str(tmp_path / name))):
        check_output(tmp_path / name)
