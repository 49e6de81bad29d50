"""Folder of machine code: only this user can write there; and old code is removed from it."""

import os

import pytest

from cmpsp_ros.mpsp.jit import kernel_folder, prune
from cmpsp_ros.mpsp.jit.cache import MAX_AGE

NOW = 2_000_000_000.0
DAY = 86_400.0


def test_it_is_in_the_user_s_cache(environment, tmp_path):
    folder = kernel_folder()
    assert folder == tmp_path / 'home' / '.cache' / 'cmpsp_ros' / 'kernels'
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize('name', ['XDG_CACHE_HOME', 'NUMBA_CACHE_DIR'])
def test_it_goes_where_the_user_says(environment, tmp_path, name):
    environment(**{name: tmp_path / 'elsewhere'})
    assert kernel_folder().parent == tmp_path / 'elsewhere' / 'cmpsp_ros'


def test_without_a_place_of_one_s_own_it_is_below_the_temporary_files(environment, tmp_path):
    (tmp_path / 'file').touch()
    environment(NUMBA_CACHE_DIR=tmp_path / 'file')
    assert kernel_folder().parent == tmp_path / 'tmp' / f'cmpsp_ros-{os.getuid()}'


def test_a_folder_that_others_may_write_to_is_not_used(environment, tmp_path):
    open_to_all = tmp_path / 'home' / '.cache' / 'cmpsp_ros'
    open_to_all.mkdir(parents=True)
    open_to_all.chmod(0o777)
    assert kernel_folder().is_relative_to(tmp_path / 'tmp')


def test_nor_one_that_leads_elsewhere(environment, tmp_path):
    (tmp_path / 'other').mkdir(mode=0o700)
    (tmp_path / 'home' / '.cache').mkdir()
    (tmp_path / 'home' / '.cache' / 'cmpsp_ros').symlink_to(tmp_path / 'other')
    assert kernel_folder().is_relative_to(tmp_path / 'tmp')


@pytest.mark.skipif(os.getuid() != 0, reason='only root can give a folder away')
def test_nor_one_of_another_user(environment, tmp_path):
    folder = kernel_folder()
    kernel_folder.cache_clear()
    os.chown(folder, 12345, 12345)
    assert kernel_folder().is_relative_to(tmp_path / 'tmp')


@pytest.fixture
def files(tmp_path):
    """Make files of 100 bytes that were used so many days ago; they are named by that."""

    def make(*ages):
        (tmp_path / 'kernels').mkdir()
        for age in ages:
            file = tmp_path / 'kernels' / f'{age}.kernel'
            file.write_bytes(bytes(100))
            os.utime(file, (NOW - age * DAY, NOW - age * DAY))
        return lambda: sorted(int(each.stem) for each in tmp_path.rglob('*.kernel'))

    return make


@pytest.mark.parametrize(
    ('size', 'kept'),
    [(500, [1, 29, 31, 40, 50]), (400, [1, 29, 31, 40]), (250, [1, 29]), (0, [1, 29])],
)
def test_the_oldest_go_while_there_is_too_much_but_none_that_was_used_this_month(
    files, tmp_path, size, kept
):
    left = files(1, 29, 31, 40, 50)
    removed = prune(tmp_path, NOW, MAX_AGE, size)
    assert left() == kept
    assert {int(each.stem) for each in removed} == {1, 29, 31, 40, 50} - set(kept)


def test_age_alone_removes_nothing(files, tmp_path):
    left = files(1, 1000)
    assert prune(tmp_path, NOW) == []
    assert left() == [1, 1000]


def test_there_may_be_nothing_to_remove(tmp_path):
    assert prune(tmp_path / 'nowhere', NOW, 0.0, 0) == []
