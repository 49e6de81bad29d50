"""When the simulated robot drives on: with a steady clock, or with the answers to its odometry."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rclpy.duration import Duration

from cmpsp_ros.nodes.common.topic import steady_timer
from cmpsp_ros.nodes.common.topics import OF_A_RUN

if TYPE_CHECKING:
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry

    from cmpsp_ros.nodes.sim.node import SimNode

_NS = 1_000_000_000

REPEAT_PERIOD = 0.1  # wall time after which odometry that is not answered is published again [s]
CATCH_UP = 50  # most odometry instants published in one go: commands must be heard between them
LATE = 0.1  # wall time by which odometry may be late before a word is said [s]


class RealTime:
    """Simulated time follows a steady clock; odometry falls due at exact instants of it."""

    def __init__(self, sim: SimNode) -> None:
        self._sim = sim
        self._factor = sim.values['real_time_factor']
        self._start_ns, self._begun_ns = sim.plant.stamp_ns, time.monotonic_ns()
        self._timer = steady_timer(sim, 0.0, self._on_timer)

    def hear(self, twist: Twist, _stamp_ns: int | None = None) -> None:
        """Obey a command at the present simulated time, after all odometry due before it."""
        self._catch_up()
        self._sim.obey(twist)

    def before_reset(self) -> None:
        """Drive up to now."""
        self._catch_up()

    def after_reset(self) -> None:
        """The next odometry comes when it is due."""

    def _on_timer(self) -> None:
        self._catch_up()
        wait = (self._sim.instants.next_ns - self._clock_ns()) / self._factor
        # Armed anew for every instant: a period of its own would drift against the grid.
        self._timer.timer_period_ns = max(1, math.ceil(wait))
        self._timer.reset()

    def _catch_up(self) -> None:
        sim, clock_ns = self._sim, self._clock_ns()
        next_ns = sim.instants.next_ns
        late = (clock_ns - next_ns) / _NS / self._factor
        if late > LATE:
            sim.get_logger().warning(
                f'odometry is {late:.2f} s late: this machine does not keep up with '
                f'odom_rate {sim.values["odom_rate"]} Hz and real_time_factor {self._factor}',
                throttle_duration_sec=5.0,
            )
        sim.run_to(min(clock_ns, next_ns + (CATCH_UP - 1) * sim.instants.period_ns))

    def _clock_ns(self) -> int:
        return self._start_ns + int((time.monotonic_ns() - self._begun_ns) * self._factor)


class Lockstep:
    """Simulated time stands still at control instants until their odometry is answered.

    It also waits for subscribers that fall behind, such as a recorder: no message of a run is lost.
    """

    def __init__(self, sim: SimNode) -> None:
        self._sim = sim
        self._control_ns = round(sim.values['control_period'] * _NS)
        self._final_ns = round(sim.values['final_time'] * _NS) or math.inf
        self._awaited: Odometry | None = None
        self._begun_ns = sim.plant.stamp_ns
        self._asked_at = 0.0
        self._is_heard = self._is_overdue = False
        self._confirmed, self._waits = 0, True
        self._timer = steady_timer(sim, REPEAT_PERIOD, self._on_timer)

    def hear(self, twist: Twist, stamp_ns: int | None = None) -> None:
        """Take the answer to the odometry awaited, and drive to the next control instant.

        A twist that is refused is an answer, too: guidance will not speak again for the
        same instant.
        """
        now_ns = self._sim.plant.stamp_ns
        if not self._is_heard or (stamp_ns is not None and stamp_ns != now_ns):
            return
        if self._is_overdue:
            self._is_overdue = False
            waited = time.monotonic() - self._asked_at
            self._sim.get_logger().info(f'lockstep goes on after {waited:.1f} s')
        self._sim.obey(twist)
        self._go_to(self._next_instant(now_ns))
        self._asked_at = time.monotonic()
        self._timer.reset()

    def before_reset(self) -> None:
        """Time stands still: there is nothing to drive."""

    def after_reset(self) -> None:
        """Ask again, from the pose where the robot stands now."""
        if self._awaited is not None:
            self._awaited = self._sim.measure()
            self._sim.publish(self._awaited)
            self._go_on()

    def _go_to(self, stamp_ns: int) -> None:
        self._confirm()
        self._awaited = self._sim.run_to(stamp_ns)
        if self._sim.measured_ns < stamp_ns:
            self._awaited = None
        self._go_on()

    def _go_on(self) -> None:
        """Drive on while odometry is lost or not yet due: nobody could answer it."""
        while self._awaited is None:
            self._awaited = self._sim.run_to(self._sim.instants.next_ns)

    def _confirm(self) -> None:
        """Wait until subscribers have what was published, before a queue is half full."""
        if self._sim.published - self._confirmed < OF_A_RUN // 2 or not self._waits:
            return
        limit = Duration(seconds=self._sim.values['lockstep_timeout'])
        self._waits = all(each.wait_for_all_acked(limit) for each in self._sim.publishers)
        self._confirmed = self._sim.published
        if not self._waits:
            self._sim.get_logger().warning(
                f'lockstep: a subscriber is behind by more than {limit.nanoseconds / _NS} s; '
                'it is not waited for any more and may lose messages'
            )

    def _next_instant(self, now_ns: int) -> int:
        """The next control instant but for one nearer than half a period; later, a period on."""
        elapsed_ns = now_ns - self._begun_ns
        if elapsed_ns >= self._final_ns:
            return now_ns + self._control_ns
        earliest_ns = elapsed_ns + self._control_ns // 2
        return self._begun_ns - (-earliest_ns // self._control_ns) * self._control_ns

    def _on_timer(self) -> None:
        if self._awaited is None:
            self._go_to(self._sim.plant.stamp_ns)
            self._begun_ns = self._sim.plant.stamp_ns
        else:
            self._sim.publish(self._awaited)
        if not self._is_heard:
            self._is_heard = self._sim.odometry.get_subscription_count() > 0
            self._asked_at = time.monotonic()
        waited = time.monotonic() - self._asked_at
        if not self._is_overdue and waited > self._sim.values['lockstep_timeout']:
            self._is_overdue = True
            self._sim.get_logger().error(
                f'lockstep: no cmd_vel for {waited:.1f} s in answer to odometry of '
                f'{self._sim.plant.stamp_ns / _NS} s; still waiting'
            )
