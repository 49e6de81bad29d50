"""The package as a robot gets it: built by colcon, found through the ament index."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'cmpsp_ros'
EXECUTABLES = ('cmpsp', 'guidance_node', 'sim_node', 'recorder')
IGNORED = {'build', 'install', 'log', 'runs', 'dist', '__pycache__'}

# One build for all: the group keeps these tests on one worker.
pytestmark = [pytest.mark.xdist_group('colcon'), pytest.mark.timeout(900)]


def source_files() -> list[Path]:
    """Files of the tree that belong to the project, relative to its root."""
    command = ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard']
    try:
        listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        names = []
    else:
        names = [name for name in listing.stdout.split('\0') if name]
    # An archive may be unpacked inside some other repository, which does not list it.
    if 'package.xml' in names:
        return [Path(name) for name in names if (ROOT / name).is_file()]

    found = []
    for folder, subfolders, files in os.walk(ROOT):
        subfolders[:] = [
            name
            for name in subfolders
            if name not in IGNORED and not name.endswith('.egg-info') and not name.startswith('.')
        ]
        found += [(Path(folder) / name).relative_to(ROOT) for name in files]
    return found


def is_hidden(path: Path) -> bool:
    return any(part.startswith('.') for part in path.parts)


@pytest.fixture(scope='session')
def colcon_build(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[Path, subprocess.CompletedProcess[str]]]:
    """Workspace with a copy of the tree, built; and what colcon said."""
    colcon = Path(sys.executable).parent / 'colcon'
    assert colcon.is_file(), f'no colcon beside {sys.executable}'

    workspace = tmp_path_factory.mktemp('colcon')
    for path in source_files():
        target = workspace / 'src' / PACKAGE / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, target)

    env = {name: text for name, text in os.environ.items() if not name.startswith('COLCON_')}
    env['PATH'] = os.pathsep.join([str(colcon.parent), env.get('PATH', os.defpath)])
    env['COLCON_HOME'] = str(workspace / 'home')
    command = [str(colcon), '--log-base', 'log', 'build', '--base-paths', 'src']
    command += ['--executor', 'sequential']
    command += ['--event-handlers', 'console_direct+', 'desktop_notification-', 'status-']
    build = subprocess.run(
        command, cwd=workspace, env=env, capture_output=True, text=True, timeout=240, check=False
    )
    yield workspace, build
    shutil.rmtree(workspace, ignore_errors=True)


@pytest.fixture(scope='session')
def colcon_install(colcon_build: tuple[Path, subprocess.CompletedProcess[str]]) -> Path:
    """The `install` folder of a colcon workspace that holds this package only."""
    workspace, build = colcon_build
    if build.returncode:
        pytest.fail(f'colcon build failed:\n{build.stdout}\n{build.stderr}')
    return workspace / 'install'


@pytest.fixture(scope='session')
def share(colcon_install: Path) -> Path:
    return colcon_install / PACKAGE / 'share' / PACKAGE


def test_build_succeeds_and_accepts_the_manifest(
    colcon_build: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    _, build = colcon_build
    said = build.stdout + build.stderr
    assert build.returncode == 0, said
    assert '1 package finished' in said
    # An invalid manifest is only a warning there, but the package then misses its ament hooks.
    warnings = [line for line in said.splitlines() if 'WARNING' in line]
    assert not [line for line in warnings if 'package.xml' in line or 'manifest' in line], said


@pytest.mark.parametrize('name', EXECUTABLES)
def test_executable_is_where_ros2_run_looks(colcon_install: Path, name: str) -> None:
    path = colcon_install / PACKAGE / 'lib' / PACKAGE / name
    assert path.is_file()
    assert os.access(path, os.X_OK)
    interpreter = path.read_text(encoding='utf-8').splitlines()[0].removeprefix('#!').strip()
    assert Path(interpreter).parent == Path(sys.executable).parent


def test_ament_index_knows_the_package(colcon_install: Path, share: Path) -> None:
    index = colcon_install / PACKAGE / 'share' / 'ament_index' / 'resource_index'
    assert (index / 'packages' / PACKAGE).is_file()
    assert (share / 'package.xml').read_bytes() == (ROOT / 'package.xml').read_bytes()


def test_install_can_be_sourced(colcon_install: Path, share: Path) -> None:
    assert (colcon_install / 'local_setup.bash').is_file()
    assert (share / 'hook' / 'ament_prefix_path.sh').is_file()
    script = f'. {colcon_install}/local_setup.bash && echo "$AMENT_PREFIX_PATH"'
    answer = subprocess.run(
        ['bash', '-c', script], capture_output=True, text=True, timeout=250, check=True
    )
    assert str(colcon_install / PACKAGE) in answer.stdout.strip().split(os.pathsep)


@pytest.mark.parametrize('folder', ['config', 'launch'])
def test_shared_files_keep_their_folders(share: Path, folder: str) -> None:
    wanted = {
        path
        for path in source_files()
        if path.parts[0] == folder and not is_hidden(path) and '__pycache__' not in path.parts
    }
    installed = {
        path.relative_to(share)
        for path in (share / folder).rglob('*')
        if path.is_file() and '__pycache__' not in path.parts
    }
    assert installed == wanted
    for path in wanted:
        assert (share / path).read_bytes() == (ROOT / path).read_bytes()


def test_python_package_is_typed_and_alone(colcon_install: Path) -> None:
    [packages] = (colcon_install / PACKAGE / 'lib').glob('python*/site-packages')
    assert (packages / PACKAGE / 'py.typed').is_file()
    assert not (packages / 'test').exists()


def test_installed_nodes_complete_a_run(
    colcon_install: Path, share: Path, ros: Any, spawn: Callable[..., Any]
) -> None:
    programs = colcon_install / PACKAGE / 'lib' / PACKAGE
    [packages] = (colcon_install / PACKAGE / 'lib').glob('python*/site-packages')
    decided: list[dict[str, str]] = []

    def on_decision(message: DiagnosticArray) -> None:
        decided.append({each.key: each.value for each in message.status[0].values})

    ros.node.create_subscription(DiagnosticArray, '/guidance/decision', on_decision, 100)
    common = ['--ros-args', '--params-file', share / 'config' / 'case3.yaml']
    lockstep = ['-p', 'lockstep:=true', '-p', 'publish_clock:=true']
    # What sourcing the workspace does: its packages come before any other copy.
    paths = os.pathsep.join([str(packages), *filter(None, [os.environ.get('PYTHONPATH')])])
    spawn([programs / 'sim_node', *common, *lockstep], PYTHONPATH=paths)
    flags = ['-p', 'use_sim_time:=true', '-p', 'autostart:=true']
    guidance = spawn([programs / 'guidance_node', *common, *flags], PYTHONPATH=paths)
    # The ROS wheels start Python once more, and for a moment the process has no command line.
    command = Path(f'/proc/{guidance.pid}/cmdline')
    ros.spin_until(lambda: str(programs / 'guidance_node') in command.read_text().split('\0'))
    # An installed copy compiles for itself, once.
    ros.spin_until(lambda: decided and decided[-1]['finished'] == 'true', 600.0)
    assert float(decided[-1]['terminal_error']) < 1e-6
