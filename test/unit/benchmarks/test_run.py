"""The benchmark once, at a small size, with every solver that is installed; and its command."""

import json

import pytest
from commands import command

from benchmarks.common import BenchError
from benchmarks.results import Order
from benchmarks.run import run

# What they share takes long to make.
pytestmark = pytest.mark.xdist_group('bench_results')


def invoke(*args):
    return command('bench', *args)


@pytest.mark.slow
def test_all_that_was_asked_for_is_there(results):
    assert [each.name for each in results.robots] == ['jackal']
    assert [each.steps for each in results.long_horizons.found] == [25, 50]
    (case3,) = results.presets
    assert (case3.name, case3.first.count, case3.every.count) == ('case3', 2, 100)
    assert 0.0 < case3.every.median <= case3.every.p99 <= case3.every.largest
    for each in [*results.robots, *results.models]:
        assert each.times.shape == (2, 50)
        assert each.times.min() > 0.0
        assert each.work.min() > 0
        assert sum(each.levels.values()) == 50
        assert each.terminal_error < 0.01
    for each in results.plans:
        assert each.first.shape == each.second.shape == (20,)
        assert min(each.first.min(), each.second.min()) > 0.0
    for each in results.long_horizons.found:
        assert 0.4 < each.active < 0.6 or each.steps == 25
        assert each.times.keys() >= {'warm', 'cold'}
        assert min(each.times.values()) > 0.0
        assert each.work > 0
    found = results.comparison
    assert (found.steps, found.runs) == (4, 2)
    assert found.timed[0].name == 'condensed + daqp'
    assert [each.name for each in results.growth] == [each.name for each in found.timed]
    assert results.growth[0].steps == [4, 6]
    assert [(each.name, each.times.shape) for each in results.tails] == [
        ('riccati active set', (12,))
    ]
    assert [(each.states, each.controls) for each in results.general] == [(3, 2), (6, 2), (12, 4)]
    assert [each.name[:7] for each in results.hard] == [
        'case3_4',
        *['table1_'] * 4,
        *['table2_'] * 3,
    ]
    assert {each.times.shape for each in results.hard} == {(2, 50)}
    assert results.hard[0].elastic == 0
    assert sum(each.elastic == 50 for each in results.hard) >= 5
    assert results.latency is None


def test_a_wrong_preset_leaves_no_folder(tmp_path):
    done = invoke('cas3', '--output', tmp_path / 'folder')
    assert done.exit_code == 1
    assert 'did you mean case3?' in done.stderr
    assert not (tmp_path / 'folder').exists()


def test_an_existing_file_is_kept(tmp_path):
    path = tmp_path / 'bench.json'
    path.write_text('mine')
    done = invoke('--output', path)
    assert done.exit_code == 1
    assert 'found an existing file' in done.stderr
    assert path.read_text() == 'mine'
    with pytest.raises(BenchError, match='existing file'):
        run(Order(['case1'], runs=1, tail=1, output=path))


@pytest.mark.slow
def test_the_command_writes_and_tells(tmp_path):
    path = tmp_path / 'bench.json'
    done = invoke('case1', '--runs', 1, '--tail', 50, '--output', path)
    assert done.exit_code == 0, done.output
    for said in (
        'turtlebot4',
        'exponent of N',
        'case1',
        'condensed + daqp',
        'guidance law',
        '[ms]',
        'not measured',
        'written',
    ):
        assert said in done.stdout
    assert json.loads(path.read_text())['presets'][0]['name'] == 'case1'
