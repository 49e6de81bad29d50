"""Clocks that jump or stop, and a slow computer; compared with doc/reference/faults.md."""

import struct
import subprocess

import pytest
from live import ZERO
from rclpy.duration import Duration
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

SECOND = 1_000_000_000
PERIOD = SECOND // 5
POSE = (0.0, -9.25, 0.0)


SETTABLE = r"""
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
static volatile long *seconds;
__attribute__((constructor)) static void begin(void) {
  seconds = mmap(0, sizeof(long), PROT_READ, MAP_SHARED, open(getenv("SET"), O_RDONLY), 0);
}
int clock_gettime(clockid_t clock, struct timespec *now) {
  int result = syscall(SYS_clock_gettime, clock, now);
  if (clock == CLOCK_REALTIME && seconds) now->tv_sec += *seconds;
  return result;
}
"""


@pytest.fixture
def set_clock(client, monkeypatch, tmp_path):
    """Set the system clock of processes to be started, and of odometry: `set_clock(seconds)`."""
    source, library, offset = (tmp_path / f'settable.{each}' for each in ('c', 'so', 'offset'))
    source.write_text(SETTABLE)
    subprocess.run(['cc', '-shared', '-fPIC', '-o', library, source], check=True)
    offset.write_bytes(struct.pack('l', 0))
    monkeypatch.setenv('SET', str(offset))
    monkeypatch.setenv('LD_PRELOAD', str(library))
    send = client.send

    def change(seconds):
        # In place: it is mapped.
        with offset.open('r+b') as file:
            file.write(struct.pack('l', seconds))
        client.send = lambda stamp, pose: send(stamp + seconds * SECOND, pose)

    return change


@pytest.fixture
def tick(start_node, client, request):
    """A node on simulated time, active; `tick(stamp)` publishes that time [ns]."""
    start_node('guidance_node', {'use_sim_time': True, **getattr(request, 'param', {})})
    clock = client.node.create_publisher(Clock, '/clock', 1)
    client.connect()
    client.until_health(state='active')
    client.until(clock.get_subscription_count)
    return lambda stamp: clock.publish(Clock(clock=Time(nanoseconds=stamp).to_msg()))


def test_a_clock_that_jumps_forward_takes_the_time_away(fault, tick, client, make_odometry):
    for stamp, time_left in ((8 * SECOND, 10.0), (8 * SECOND + PERIOD, 9.8), (13 * SECOND, 5.0)):
        tick(stamp)
        decision, command = client.decide(make_odometry(stamp, POSE))
        assert float(decision['time_left']) == time_left
        assert command[0] > 0.5
    fault.assert_decided(decision)


def test_a_clock_that_stops_alone_stops_the_robot(fault, tick, client, make_odometry):
    begin = 8 * SECOND
    for stamp in (begin, begin + PERIOD, begin + 2 * PERIOD):
        tick(begin)
        decision, command = client.decide(make_odometry(stamp, POSE))
        assert command[0] > 0.5
    decision, command = client.decide(make_odometry(begin + 3 * PERIOD, POSE))
    assert command == ZERO
    fault.assert_decided(decision)
    # The clock is back.
    tick(begin + 4 * PERIOD)
    client.recover(begin + 4 * PERIOD)


def _drives(client, message):
    client.odometry.publish(message)
    return client.commands[-1][0] > 0.5


def test_a_clock_that_stands_still_is_told(fault, tick, client, make_odometry):
    tick(8 * SECOND)
    client.decide(make_odometry(8 * SECOND, POSE))
    count = len(client.commands)
    health = client.until_health(said='stands still at 8.000 s')
    fault.assert_told(health)
    assert len(client.commands) == count
    # Time goes on, and so does the run.
    tick(8 * SECOND + PERIOD)
    client.until(lambda: _drives(client, make_odometry(8 * SECOND + PERIOD, POSE)))
    client.until(lambda: client.decisions[-1]['step'] == '1')


@pytest.mark.parametrize('tick', [{'lockstep': True}], indirect=True)
def test_in_lockstep_the_odometry_after_the_final_time_ends_the_run(tick, client, make_odometry):
    for stamp in (8 * SECOND, 18 * SECOND - PERIOD // 2):
        tick(stamp)
        client.decide(make_odometry(stamp, POSE))
    count = len(client.decisions)
    tick(18 * SECOND + PERIOD // 10)
    client.until_health(said='stands still at 18.020 s')
    assert len(client.decisions) == count
    decision, _ = client.decide(make_odometry(18 * SECOND + PERIOD // 10, POSE))
    assert (decision['finished'], decision['halted']) == ('true', 'false')


def test_a_computer_that_is_too_slow_is_told(fault, start_active, client, make_odometry):
    """A thousand steps, and iterations without end: no computer does that in 10 ms."""
    slow = {'control_period': 0.01, 'solver.iterations_per_step': 50, 'odom_timeout': 60.0}
    slow['solver.work_share'] = 0.0
    start_active(slow)
    decision, _ = client.decide(make_odometry(client.now(), POSE))
    assert decision['fallback_level'] in {'nominal', 'elastic'}
    health = client.until_health(said='took')
    fault.assert_told(health)
    assert int(health['deadline_misses']) > 0


def test_a_plan_that_takes_longer_than_odometry_lives_is_followed(fault, start_active, client):
    slow = {'control_period': 0.01, 'solver.iterations_per_step': 50, 'odom_timeout': 0.04}
    start_active({**slow, 'solver.work_share': 0.0})
    client.drive()

    def goes_on():
        late = [float(each.get('late', 0.0)) > 0.04 for each in client.decisions]
        after = client.decisions[late.index(True) + 1 :] if any(late) else []
        return next((each for each in after if each['fallback_level'] == 'previous_plan'), None)

    fault.assert_decided(client.until(goes_on))
    client.park()
    # Odometry that grew old while the law was busy is no reason to stop.
    assert not any('s old' in each['reason'] for each in client.decisions)
    assert any(speed > 0.0 for speed, _ in client.commands)


def test_a_node_that_uses_simulated_time_lives_before_there_is_any(fault, start_node, client):
    start_node('guidance_node', {'use_sim_time': True})
    health = client.until_health(state='active', said='Waiting for odometry')
    # Heard late it says as well that the clock stands still.
    assert health['said'].startswith('Waiting for odometry on /odom.')
    fault.assert_said('—', health['level'][0], 'Waiting for odometry on /odom.')
    client.connect()
    clock = client.node.create_publisher(Clock, '/clock', 10)
    client.until(clock.get_subscription_count)
    tick = Clock(clock=Time(seconds=5).to_msg())
    clock.publish(tick)
    clock.wait_for_all_acked(Duration(seconds=60.0))
    client.send(5_000_000_000)
    client.until(lambda: client.commands)
    assert client.commands[0][0] > 0.5


def test_without_a_clock_no_run_begins(fault, start_node, client):
    start_node('guidance_node', {'use_sim_time': True})
    client.connect()
    client.drive()
    reason = 'Waiting for /clock (use_sim_time).'
    health = client.until_health(state='active', said=reason)
    fault.assert_said('—', health['level'][0], health['said'][: len(reason)])
    assert client.commands == []
    clock = client.node.create_publisher(Clock, '/clock', 10)
    tick = client.node.get_clock().now
    client.node.create_timer(0.01, lambda: clock.publish(Clock(clock=tick().to_msg())))
    client.until_driving()


def test_odometry_that_stops_after_the_clock_was_set_back_stops_the_robot(
    fault, set_clock, start_driving, client
):
    start_driving()
    begun = client.now()
    set_clock(-1000)

    def is_set(decision):
        return int(decision['stamp']) < begun - 500 * SECOND

    client.until(lambda: any(map(is_set, client.decisions)))
    client.until_driving()
    client.park()
    client.until(lambda: client.decisions[-1]['reason'].startswith('No usable odometry'))
    assert is_set(client.decisions[-1])
    fault.assert_decided(client.decisions[-1])
    client.until(lambda: client.commands[-1] == ZERO)
