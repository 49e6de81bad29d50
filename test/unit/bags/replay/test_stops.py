"""Stops by the node that keep the limit of acceleration are replayed as they were."""

import numpy as np
from bag_messages import SECOND, odometry

from cmpsp_ros.bags import Names
from cmpsp_ros.bags.replay.replay import replay


def test_a_robot_that_brakes_is_replayed_as_it_was(drive, bag):
    with drive(**{'robot.max_wheel_acceleration': 30.0}) as run:
        run.go(1.94)
        for reason in (
            {'reason': 'Sensor front has shown nothing for 0.5 s (sight.timeout).'},
            {'reason': 'The goal was cancelled.', 'cancelled': True},
        ):
            while run.held.any():
                run.say(odometry(run.now, run.pose))
                run.brake(**reason)
                run.tick()
            run.go(2.02)
        run.go(run.law.ends_at / SECOND - run.now / SECOND)
        run.halt('The final time has passed.', finished=True)
        run.go(3.0)
    stops = [each for each in run.decisions if each.halted]
    assert len(stops) > 8
    speeds = np.array([each.wheel_speeds for each in run.decisions])
    assert np.abs(np.diff(speeds, axis=0)).max() <= 6.0 + 1e-6
    assert not speeds[-1].any()
    outcome = replay(bag, Names.under(''))
    assert outcome.first is None, outcome.first
    assert outcome.stops == len(stops)
