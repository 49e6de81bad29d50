"""The package as a robot gets it: built by colcon, found through the ament index."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'cmpsp_ros'
IGNORED = {'build', 'install', 'log', 'runs', 'dist', '__pycache__'}

# One build for all: the group keeps these tests on one worker.
pytestmark = [pytest.mark.xdist_group('colcon'), pytest.mark.timeout(900)]


def source_files():
    """Files of the tree that belong to the project, relative to its root."""
    command = ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard']
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        names = done.stdout.split('\0')
    except (OSError, subprocess.CalledProcessError):
        names = []
    # An archive may be unpacked inside some other repository, which does not list it.
    if 'package.xml' in names:
        return [Path(name) for name in names if name and (ROOT / name).is_file()]
    found = [each.relative_to(ROOT) for each in ROOT.rglob('*') if each.is_file()]
    return [
        path
        for path in found
        if not any(part[0] == '.' or part in IGNORED or '.egg-info' in part for part in path.parts)
    ]


@pytest.fixture(scope='module')
def build(tmp_path_factory):
    """A workspace with a copy of the tree, built."""
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
    command = [
        *(colcon, '--log-base', 'log', 'build', '--base-paths', 'src', '--executor', 'sequential'),
        *('--event-handlers', 'console_direct+', 'desktop_notification-', 'status-'),
    ]
    done = subprocess.run(
        command, cwd=workspace, env=env, capture_output=True, text=True, timeout=240, check=False
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    yield workspace / 'install', said
    shutil.rmtree(workspace, ignore_errors=True)


@pytest.fixture
def install(build):
    """Folder into which the package is installed."""
    return build[0] / PACKAGE


@pytest.fixture
def packages(install):
    """The folder of Python packages."""
    (found,) = (install / 'lib').glob('python*/site-packages')
    return found


def test_the_manifest_is_accepted(build):
    said = build[1]
    assert '1 package finished' in said
    # An invalid manifest is only a warning there, but the package then misses its ament hooks.
    warnings = [line for line in said.splitlines() if 'WARNING' in line]
    assert not [line for line in warnings if 'package.xml' in line or 'manifest' in line], said


def test_the_package_is_where_ros2_run_and_the_ament_index_look(build, install, packages):
    for name in ('cmpsp', 'guidance_node', 'sim_node', 'recorder'):
        path = install / 'lib' / PACKAGE / name
        assert os.access(path, os.X_OK)
        interpreter = path.read_text(encoding='utf-8').splitlines()[0].removeprefix('#!').strip()
        assert Path(interpreter).parent == Path(sys.executable).parent
    assert (install / 'share' / 'ament_index' / 'resource_index' / 'packages' / PACKAGE).is_file()
    assert (packages / PACKAGE / 'py.typed').is_file()
    assert not (packages / 'test').exists()
    script = f'. {build[0]}/local_setup.bash && echo "$AMENT_PREFIX_PATH"'
    sourced = subprocess.run(
        ['bash', '-c', script], capture_output=True, text=True, timeout=250, check=True
    )
    assert str(install) in sourced.stdout.strip().split(os.pathsep)


def test_shared_files_keep_their_folders(install):
    share = install / 'share' / PACKAGE
    assert (share / 'package.xml').read_bytes() == (ROOT / 'package.xml').read_bytes()
    for folder in ('config', 'launch'):
        wanted = {
            path
            for path in source_files()
            if path.parts[0] == folder and not any(part[0] == '.' for part in path.parts)
        }
        found = {each.relative_to(share) for each in (share / folder).rglob('*') if each.is_file()}
        assert {path for path in found if '__pycache__' not in path.parts} == wanted
        assert all((share / path).read_bytes() == (ROOT / path).read_bytes() for path in wanted)


def test_installed_nodes_complete_a_run(install, packages, ros, spawn):
    programs, decided = install / 'lib' / PACKAGE, []

    def on_decision(message):
        decided.append({each.key: each.value for each in message.status[0].values})

    ros.node.create_subscription(DiagnosticArray, '/guidance/decision', on_decision, 100)
    common = ['--ros-args', '--params-file', install / 'share' / PACKAGE / 'config' / 'case3.yaml']
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
