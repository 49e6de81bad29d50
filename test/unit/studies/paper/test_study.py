"""The study as a whole: its files, its report, and what it refuses."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest

from cmpsp_ros.studies import cpu_model
from cmpsp_ros.studies.paper import ARTEFACTS, StudyError, run

# What they share takes long to make.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group('paper_study')]

FIGURES = [f'fig{number}' for number in range(2, 14)]
VERDICTS = {'holds', 'does not hold', 'depends', 'not decidable'}


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    told = []
    report = run(tmp_path_factory.mktemp('whole') / 'paper', progress=told.append)
    return report, told


def claims_of(report):
    rows = [line for line in report.read_text('utf-8').splitlines() if line.startswith('| ')]
    cells = [re.split(r'(?<!\\)\|', row)[1:-1] for row in rows]
    return [[cell.strip() for cell in row] for row in cells if row[0].strip() in ARTEFACTS]


def test_files_and_progress(study):
    report, told = study
    assert set(ARTEFACTS) == {*FIGURES, 'table1', 'table2', 'timing'}
    wanted = {f'{name}.{kind}' for name in FIGURES for kind in ('png', 'svg')}
    found = {path.name for path in report.parent.iterdir()}
    assert found == {*wanted, 'results.md', 'results.json'}
    assert report.name == 'results.md'
    assert [line for line in told if line in ARTEFACTS] == list(ARTEFACTS)


def test_every_claim_has_a_verdict_and_a_reason(study):
    report, _ = study
    rows = claims_of(report)
    assert len(rows) > 35
    for row in rows:
        assert len(row) == 6, row
        assert all(row), row
        assert row[4].strip('*') in VERDICTS, row
    assert {row[0] for row in rows} == set(ARTEFACTS)
    assert {row[4].strip('*') for row in rows} == VERDICTS


def test_results_are_numbers(study):
    report, _ = study
    results = json.loads((report.parent / 'results.json').read_text('utf-8'))
    assert list(results) == list(ARTEFACTS)
    run_of_case3 = results['fig2']['between_samples']['case3']
    assert run_of_case3['measures']['miss_m'] < 1e-6
    assert run_of_case3['measures']['clearance_between_samples_m'] >= 0.0
    assert len(run_of_case3['x_m']) == 51
    assert results['fig4']['samples_only']['case2']['measures']['limit_rad_s'] is None
    assert set(results['timing']['median_ms']) == {'Case 1', 'Case 2', 'Case 3'}
    assert results['timing']['cpu'] == cpu_model() != ''


def test_pictures_have_text_and_no_date(study):
    report, _ = study
    for name in FIGURES:
        text = (report.parent / f'{name}.svg').read_text('utf-8')
        ET.fromstring(text)
        assert '<text' in text
        assert 'dc:date' not in text
        assert '[rad/s]' in text or '[m]' in text


def test_only_writes_exactly_its_files_and_repeats_bit_for_bit(tmp_path, study):
    whole, _ = study
    part = run(tmp_path / 'part', only=['fig5'])
    names = {'fig5.png', 'fig5.svg', 'results.json', 'results.md'}
    assert {path.name for path in part.parent.iterdir()} == names
    assert {row[0] for row in claims_of(part)} == {'fig5'}
    for name in ('fig5.png', 'fig5.svg'):
        assert (part.parent / name).read_bytes() == (whole.parent / name).read_bytes(), name
    one, other = (
        json.loads((report.parent / 'results.json').read_text('utf-8')) for report in (part, whole)
    )
    assert one == {'fig5': other['fig5']}


def test_matplotlib_is_left_as_it_was(tmp_path):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    run(tmp_path / 'out', only=['fig9'])
    assert dict(mpl.rcParams) == before


def test_it_runs_without_ros_and_without_a_window(tmp_path):
    code = (
        'import sys; from pathlib import Path; from cmpsp_ros.studies.paper import run;'
        'run(Path(sys.argv[1]), only=["fig3"]);'
        'unwanted = {"rclpy", "cmpsp_ros.nodes", "matplotlib.pyplot", "casadi"};'
        'sys.exit(", ".join(unwanted & set(sys.modules)) or 0)'
    )
    process = subprocess.run(
        [sys.executable, '-c', code, str(tmp_path / 'out')],
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr


def test_the_judge_adds_an_optimum(tmp_path):
    pytest.importorskip('casadi')
    report = run(tmp_path / 'out', only=['fig12'], judge=True)
    results = json.loads((report.parent / 'results.json').read_text('utf-8'))
    judged = results['fig12']['ipopt']
    assert {each['feasible'] for each in judged.values()} == {True}
    assert 'found by IPOPT' in report.read_text('utf-8')


def test_an_unknown_name_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(StudyError, match='fig1,') as refusal:
        run(tmp_path / 'out', only=['fig2', 'fig1', 'fig99'])
    for name in ('fig99', *ARTEFACTS):
        assert name in str(refusal.value)
    assert not (tmp_path / 'out').exists()


def test_only_a_new_or_empty_folder_is_used(tmp_path):
    folder, file = tmp_path / 'out', tmp_path / 'file'
    folder.mkdir()
    file.write_text('mine')
    assert run(folder, only=['table2']).exists()
    for used in (folder, file, file / 'below'):
        with pytest.raises(StudyError, match=re.escape(str(used))):
            run(used, only=['table2'])
    assert file.read_text() == 'mine'
