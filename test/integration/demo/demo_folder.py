"""Files that a run leaves behind."""

import json
import struct

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.runs import read_run

KEYS = [
    'preset',
    'reached',
    'miss_m',
    'clearance_m',
    'max_wheel_speed_rad_s',
    'step_ms',
    'deadline_misses',
    'levels',
    'control_steps',
]
TOPICS = {
    '/clock',
    '/odom',
    '/cmd_vel',
    '/diagnostics',
    '/sim/truth',
    '/sim/wheel_speeds',
    '/guidance/decision',
    '/guidance/predicted_path',
    '/guidance/wheel_speeds',
    '/guidance/markers',
}
CONTENT = {
    'bag',
    'parameters.yaml',
    'summary.json',
    'trajectory.png',
    'wheel_speeds.png',
    'recorder.log',
    'sim_node.log',
    'guidance_node.log',
}
LIMITS = {'case1': float('inf'), 'case2': float('inf'), 'case3': 51.0, 'case3_45': 45.0}


def commands(folder):
    """Serialised commands, and their speeds."""
    with Bag(folder / 'bag') as bag:
        raw = [each for _, each in bag.raw('/cmd_vel')]
        twists = [(each.linear.x, each.angular.z) for _, each in bag.messages('/cmd_vel')]
    return raw, twists


def size_of_png(path):
    head = path.read_bytes()[:24]
    assert head[:8] == b'\x89PNG\r\n\x1a\n'
    return struct.unpack('>II', head[16:24])


def check_folder(folder, preset):
    """Check the files of a run that came to its end; returns its summary."""
    assert {each.name for each in folder.iterdir()} == CONTENT
    summary = json.loads((folder / 'summary.json').read_text())
    assert list(summary) == KEYS
    assert set(summary['step_ms']) == {'p50', 'p99', 'max'}
    assert set(summary['levels']) == {'nominal', 'elastic', 'previous_plan', 'stop'}
    assert summary['preset'] == preset
    assert summary['control_steps'] == sum(summary['levels'].values()) == 50
    assert summary['levels']['previous_plan'] == summary['levels']['stop'] == 0
    assert summary['clearance_m'] >= 0.0
    assert 0.0 < summary['max_wheel_speed_rad_s'] <= LIMITS[preset]
    assert 0.0 < summary['step_ms']['p50'] <= summary['step_ms']['p99'] <= summary['step_ms']['max']
    for picture in ('trajectory.png', 'wheel_speeds.png'):
        assert all(400 <= pixels <= 2000 for pixels in size_of_png(folder / picture))
        assert 10_000 < (folder / picture).stat().st_size < 1_000_000
    for log in folder.glob('*.log'):
        assert 'Traceback' not in log.read_text()
    return summary


def check_bag(folder):
    with Bag(folder / 'bag') as bag:
        assert set(bag.parameters) == {'/guidance', '/sim'}
        assert bag.parameters['/guidance']['weights.road_center'] == 15.0
        assert bag.parameters['/sim']['initial_pose'] == [0.0, -9.25, 0.0]
        topics = set(bag.topics)
    run = read_run(folder / 'bag')
    _, twists = commands(folder)
    assert all(speed > 0.5 for speed, _ in twists[:50])
    assert set(twists[50:]) == {(0.0, 0.0)}
    assert [each.finished for each in run.decisions[:51]] == [False] * 50 + [True]
    assert len(run.plans) == 50
    return topics
