"""The catalogue: every row is whole, and what the nodes rely on stays fixed while they run."""

import pytest

from cmpsp_ros.parameters import TABLE
from cmpsp_ros.parameters.parameter import REQUIRED


@pytest.mark.parametrize('row', list(TABLE), ids=lambda row: row.name)
def test_each_row_is_whole(row):
    assert row.nodes <= {'guidance', 'sim'}
    assert row.nodes
    assert row.description.endswith('.')
    assert row.default is REQUIRED or row.read('key', row.default) == row.default


def test_what_needs_a_restart():
    assert {row.name for row in TABLE if not row.reconfigurable} == {
        'frame_id', 'robot_frame', 'control_period', 'final_time',
        'goal.wait', 'waypoints.names', 'waypoints.<name>.time',
        'follow.speed', 'follow.horizon', 'robot.model', 'robot.max_wheel_acceleration',
        'robot.max_steering_rate',
        'robot.joint_names',
        'road.type', 'road.source',
        'map.unknown_is_free', 'map.topic', 'map.lethal', 'map.timeout',
        'weights.control_rate', 'solver.qp',
        'enable_stamped_cmd_vel', 'autostart',
        'recorder_timeout', 'stop_with_process', 'initial_pose', 'odom_rate',
        'odom_jitter', 'clock_offset', 'real_time_factor', 'publish_clock',
        'lockstep', 'noise.dropout_windows', 'noise.seed',
        'realtime.priority', 'realtime.cpu',
        'moving_obstacles.capacity', 'moving_obstacles.names', 'moving_obstacles.<name>.center',
        'moving_obstacles.<name>.velocity', 'moving_obstacles.<name>.radius',
        'others.namespaces',
        'trackers.names', 'trackers.<name>.topic', 'trackers.<name>.type',
        'trackers.<name>.radius', 'trackers.<name>.position_stddev',
        'sensors.names', 'sensors.<name>.type', 'sensors.<name>.topic',
        'sensors.<name>.frame_id', 'sensors.<name>.pose', 'sensors.<name>.reach',
        'sensors.<name>.heights', 'sight.size', 'sight.resolution', 'sight.memory',
        'sight.timeout', 'sight.moving',
        'sim.scan.rate', 'sim.scan.frame_id', 'sim.scan.pose', 'sim.scan.angle_min',
        'sim.scan.angle_max', 'sim.scan.count', 'sim.scan.time_increment', 'sim.scan.range_min',
        'sim.scan.range_max', 'sim.scan.stddev', 'sim.scan.dropout', 'sim.scan.missed_return',
        'sim.scan.road_edges',
        'sim.people.names', 'sim.people.<name>.position', 'sim.people.<name>.motion',
        'sim.people.<name>.heading', 'sim.people.<name>.waypoints', 'sim.people.<name>.speed',
        'sim.people.<name>.radius', 'sim.people.<name>.gives_way', 'sim.people.<name>.count',
        'sim.people.acceleration', 'sim.people.legs',
        'plant', 'physics.mass', 'physics.friction', 'physics.torque', 'physics.odometry',
    }  # fmt: skip
