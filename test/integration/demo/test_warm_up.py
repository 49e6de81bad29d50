"""`cmpsp warmup` compiles all that a run needs."""

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

COMPILING = 1500.0


@pytest.mark.parametrize('preset', ['case3'])
def test_after_a_warm_up_from_an_empty_folder_no_run_adds_a_kernel(
    start_cmpsp, start_demo, tmp_path, preset
):
    caches = tmp_path / 'caches'
    caches.mkdir(mode=0o700)
    empty = {'NUMBA_CACHE_DIR': str(caches)}
    warming = start_cmpsp('warmup', preset, **empty)
    assert warming.wait(COMPILING) == 0, warming.stderr
    kernels = files_in(caches)
    assert kernels
    for name, options in (('lockstep', ['--lockstep']), ('live', [])):
        folder = tmp_path / name
        running = start_demo(preset, *options, '--output', folder, **empty)
        assert running.wait() == 0, running.stderr
        assert files_in(caches) - kernels == set(), name
        for command in ('audit', 'replay'):
            judged = start_cmpsp(command, folder / 'bag', **empty)
            assert judged.wait() == 0, judged.stdout + judged.stderr
            assert files_in(caches) - kernels == set(), f'{command} of {name}'


def files_in(folder):
    """Paths of the files in a folder and below."""
    return {each.relative_to(folder) for each in folder.rglob('*') if each.is_file()}
