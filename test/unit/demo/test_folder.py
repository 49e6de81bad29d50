"""The folder of a run: made anew, or cleared of a run and of nothing else."""

from __future__ import annotations

import pytest

from cmpsp_ros.demo import DemoError, make_folder


def test_a_new_folder_is_made_with_its_parents(tmp_path):
    folder = tmp_path / 'a' / 'b'
    assert make_folder(folder, force=False) == folder
    assert folder.is_dir()


def test_an_existing_folder_is_refused_and_left_alone(tmp_path):
    (tmp_path / 'summary.json').write_text('{}')
    with pytest.raises(DemoError, match='found an existing folder, wanted a new one; --force'):
        make_folder(tmp_path, force=False)
    assert (tmp_path / 'summary.json').exists()


def test_force_removes_an_earlier_run_and_nothing_else(tmp_path):
    (tmp_path / 'bag').mkdir()
    for name in ('bag/bag.mcap', 'summary.json', 'trajectory.png', 'sim_node.log', 'mine.txt'):
        (tmp_path / name).write_text('x')
    (tmp_path / 'bags').mkdir()
    make_folder(tmp_path, force=True)
    assert {each.name for each in tmp_path.iterdir()} == {'mine.txt', 'bags'}
    make_folder(tmp_path / 'new', force=True)
    assert (tmp_path / 'new').is_dir()


@pytest.mark.parametrize('force', [True, False])
@pytest.mark.parametrize('inside', [True, False])
def test_a_file_in_the_way_is_told_and_stays(tmp_path, force, inside):
    file = tmp_path / 'file'
    file.write_text('mine')
    with pytest.raises(DemoError, match=str(file)):
        make_folder(file / 'run' if inside else file, force=force)
    assert file.read_text() == 'mine'


def test_without_a_name_it_is_the_time_and_latest_points_at_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'runs' / 'old').mkdir(parents=True)
    (tmp_path / 'runs' / 'latest').symlink_to('old')
    folder = make_folder(None, force=False)
    assert folder.parent.name == 'runs'
    assert folder.is_dir()
    latest = tmp_path / 'runs' / 'latest'
    assert latest.is_symlink()
    assert latest.resolve() == folder.resolve()
