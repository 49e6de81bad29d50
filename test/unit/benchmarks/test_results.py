"""Targets, tables, pictures, JSON and the page."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.over_dds.latency import Latency
from benchmarks.report import content, page, write

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
