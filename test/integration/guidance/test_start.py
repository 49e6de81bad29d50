"""Start and end of runs of real nodes."""

from __future__ import annotations

import pytest
from live import MS

pytestmark = pytest.mark.integration

PATIENT = {'odom_timeout': 60.0, 'safety.max_odom_jump': 0.0}


@pytest.mark.smoke
def test_off_the_road_no_run_begins_until_the_robot_is_on_it(
    fault, start_active, client, make_odometry
):
    """Most odometry begins at (0, 0, 0), wherever the course is."""
    start_active(PATIENT)
    decision, command = client.decide(make_odometry(client.now(), (0.0, 0.0, 0.0)))
    assert command == (0.0, 0.0)
    fault.assert_decided(decision)
    assert '9 m off the road, more than 0.5 m (start.tolerance)' in decision['reason']
    decision, command = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert (decision['step'], decision['fallback_level']) == ('0', 'nominal')
    assert float(decision['time_left']) == 10.0
    assert command[0] > 0.5
    # Once it has begun it is led back from anywhere.
    later = client.now() + 200 * MS
    decision, command = client.decide(make_odometry(later, (0.0, -12.0, 0.0)))
    assert command != (0.0, 0.0)


def test_the_clock_stops_the_robot_and_odometry_judges_the_goal(
    fault, start_active, client, make_odometry
):
    start_active({'odom_timeout': 5.0, 'final_time': 1.0})
    begun = client.now()
    client.decide(make_odometry(begun, (0.0, -9.25, 0.0)))
    client.until(lambda: client.decisions[-1]['finished'] == 'true')
    stop = client.decisions[-1]
    assert (stop['halted'], client.commands[-1]) == ('true', (0.0, 0.0))
    assert 1000 * MS < int(stop['stamp']) - begun < 1500 * MS
    fault.assert_decided(stop)
    decision, command = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert (decision['finished'], decision['halted']) == ('true', 'false')
    assert 'm from the goal' in decision['reason']
    assert command == (0.0, 0.0)


def test_what_cannot_be_done_is_foretold_by_the_node(start_active, client, make_odometry):
    start_active({'final_time': 5.0, 'cmd_vel_timeout': 0.1})
    decision, _ = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert 'The goal is out of reach by ' in decision['reason']
    health = client.until_health(said='The goal is out of reach by ')
    assert 'control_period = 0.2 s is not shorter than cmd_vel_timeout = 0.1 s' in health['said']
    assert health['level'] != b'\x00'
