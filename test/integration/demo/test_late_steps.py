"""A computer that is too slow for its task, by `cmpsp demo`."""

import json

import pytest
from demo_folder import TOPICS

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.runs import read_run

pytestmark = pytest.mark.integration

# Twenty milliseconds for many times that work.
SLOW = ('control_period=0.02', 'solver.work_share=1.0', 'solver.candidates=8')
SLOW += ('solver.iterations_per_step=100', 'odom_rate=100.0')


def test_late_steps_are_counted_and_the_run_is_judged(start_demo, start_cmpsp, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder, *(f'--set={each}' for each in SLOW))
    assert running.wait() in {0, 1}, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    run = read_run(folder / 'bag')
    withdrawn = [each for each in run.decisions if each.late]
    assert withdrawn
    assert summary['deadline_misses'] >= len(withdrawn)
    assert all(each.misses_deadline(0.02, 0.0) for each in withdrawn)
    shown = ' '.join(running.stdout.split())
    assert f'deadlines missed │ {summary["deadline_misses"]}' in shown
    with Bag(folder / 'bag') as bag:
        assert set(bag.topics) >= TOPICS - {'/clock'}
        counts = {name: each.count for name, each in bag.topics.items()}
        (*_, health) = [
            {each.key: each.value for each in status.values}
            for _, message in bag.messages('/diagnostics')
            for status in message.status
            if status.name == '/guidance: guidance'
        ]
    assert counts['/guidance/decision'] == len(run.decisions)
    # A busy machine may not have recorded them all.
    assert 0 < counts['/cmd_vel'] <= len(run.decisions) - len(withdrawn)
    assert int(health['deadline_misses']) >= summary['deadline_misses']
    replayed = start_cmpsp('replay', folder / 'bag')
    assert replayed.wait() == 0, replayed.stdout
