"""Machine code is compiled by one process and loaded by the others, whatever its file suffers."""

import os
import shutil
import time
from pathlib import Path

import pytest

import cmpsp_ros
from cmpsp_ros.mpsp.jit import allocation_free

# Programs of their own compile in each test.
pytestmark = pytest.mark.slow

DOUBLE = """
from typing import NamedTuple
from cmpsp_ros.mpsp.jit import allocation_free

class Data(NamedTuple):
    x: int

@allocation_free
def double(data):
    return Data(2 * data.x)

def explain():
    return 'it went wrong'
"""
RUN = 'print(double(Data(4)).x, sum(double.stats.cache_hits.values()))\n'
SLOW = """
import time, numba
from cmpsp_ros.mpsp.jit import allocation_free

def add(x):
    raise NotImplementedError

@numba.extending.overload(add)
def _add(x):
    time.sleep(1.0)
    return lambda x: x + 1

@allocation_free
def kernel(x):
    return add(x)

print(kernel(1), sum(kernel.stats.cache_hits.values()))
"""


INNER = """
import time, numba
import numpy as np
from cmpsp_ros.mpsp.jit import address_of, allocation_free, call, inner

def wait():
    raise NotImplementedError

@numba.extending.overload(wait)
def _wait():
    time.sleep(3.0)
    return lambda: None

@inner
def put(x):
    wait()
    x[0] = 2.0

@allocation_free
def run(address, x):
    call(address, (x,))

x = np.zeros(1)
run(address_of(None, put, x), x)
print(int(x[0]))
"""


def test_the_next_process_loads_it_with_classes_of_its_own_program(run):
    assert [run(DOUBLE + RUN) for _ in range(2)] == [['8', '0'], ['8', '1']]
    assert run(DOUBLE.replace('it went wrong', 'no') + '\n# The end.\n' + RUN) == ['8', '1']
    assert run(DOUBLE.replace('2 *', '3 *') + RUN) == ['12', '0']


def test_code_that_is_in_no_file_is_kept_as_well(run):
    source = f'exec({DOUBLE + RUN!r})'
    assert [run(source) for _ in range(2)] == [['8', '0'], ['8', '1']]


def test_a_copy_of_a_module_elsewhere_finds_it(run, tmp_path, monkeypatch):
    said = []
    for name in ('first', 'second'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'copied.py').write_text(DOUBLE)
        monkeypatch.syspath_prepend(tmp_path / name)
        program = f'import sys; sys.path.insert(0, {name!r}); from copied import *\n'
        said.append(run(program + RUN))
    assert said == [['8', '0'], ['8', '1']]


def test_another_version_of_the_compiler_has_files_of_its_own(run, tmp_path):
    assert run(DOUBLE + RUN) == ['8', '0']
    copied = shutil.copytree(Path(cmpsp_ros.__file__).parent, tmp_path / 'cmpsp_ros')
    with (copied / 'mpsp/jit/parts.py').open('a') as file:
        file.write('# Another version.\n')
    assert [run(DOUBLE + RUN) for _ in range(2)] == [['8', '0'], ['8', '1']]


def test_a_damaged_file_is_compiled_anew_and_mended(run, folder):
    run(DOUBLE + RUN)
    (file,) = folder.glob('*.kernel')
    whole = file.read_bytes()
    for damaged in (b'', whole[:-1], whole[:5000] + bytes(len(whole) - 5000)):
        file.write_bytes(damaged)
        assert [run(DOUBLE + RUN) for _ in range(2)] == [['8', '0'], ['8', '1']]
    assert [*folder.glob('*.kernel')] == [file]


def test_without_any_folder_kernels_are_compiled_all_the_same(run, environment, tmp_path):
    (tmp_path / 'file').touch()
    environment(NUMBA_CACHE_DIR=tmp_path / 'file')
    (tmp_path / 'tmp' / f'cmpsp_ros-{os.getuid()}').touch()
    assert [run(DOUBLE + RUN) for _ in range(2)] == [['8', '0'], ['8', '0']]


def test_bitcode_is_parsed_only_for_what_is_compiled_against_it(run):
    program = f'import numba\n{DOUBLE}{RUN}'
    run(program)
    program += 'loaded = double.overloads[double.signatures[0]].library\n'
    program += 'print(type(loaded.bitcode).__name__)\n'
    program += 'four_times = numba.njit(lambda data: double(double(data)))\n'
    program += 'print(four_times(Data(4)).x, type(loaded.bitcode).__name__)'
    assert run(program) == ['8', '1', 'bytes', '16', 'NoneType']


def test_what_numba_keeps_for_others_is_loaded_as_ever(run, tmp_path):
    (tmp_path / 'others.py').write_text(
        'import numba\n@numba.njit(cache=True)\ndef treble(x):\n    return 3 * x\n'
    )
    program = f'from others import *\n{DOUBLE}{RUN}'
    program += 'print(treble(4), sum(treble.stats.cache_hits.values()))\n'
    assert [run(program) for _ in range(2)] == [['8', '0', '12', '0'], ['8', '1', '12', '1']]


def test_two_processes_that_want_it_at_once_compile_it_once(start, folder):
    both = [start(SLOW), start(SLOW)]
    said = sorted(each.communicate(timeout=250.0)[0] for each in both)
    assert said == ['2 0\n', '2 1\n']
    assert len([*folder.glob('*.kernel')]) == 1


def test_two_processes_may_number_their_functions_in_another_way(start):
    before = DOUBLE + 'double(Data(4))'
    programs = [INNER, before + INNER]
    both = [start(source, name=f'program_{k}.py') for k, source in enumerate(programs)]
    assert [each.communicate(timeout=250.0)[0] for each in both] == ['2\n', '2\n']


def kernel():
    @allocation_free
    def successor(x):
        return x + 1

    return successor


def test_a_kernel_that_cannot_be_compiled_leaves_no_lock(folder):
    @allocation_free
    def wrong(x):
        return x.nowhere

    with pytest.raises(Exception, match='nowhere'):
        wrong(1)
    assert [*folder.glob('*.kernel')] == []


def test_a_full_disk_is_forgiven(run, folder):
    full = 'import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n'
    assert run(full + DOUBLE + RUN) == ['8', '0']
    assert [*folder.glob('*.kernel')] == []


def test_a_folder_that_vanishes_in_between_does_no_harm(folder):
    successor = kernel()
    folder.rmdir()
    assert successor(1) == 2


def test_using_a_file_renews_its_date_once_a_day(folder):
    kernel()(1)
    (file,) = folder.glob('*.kernel')
    now = time.time()
    for age, renewed in ((2 * 86_400, True), (3_600, False)):
        os.utime(file, (now - age, now - age))
        kernel()(1)
        assert (file.stat().st_mtime >= now - 60) == renewed
