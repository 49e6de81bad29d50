"""A recorded run as arrays: decisions, goals, moving obstacles and encounters."""

from cmpsp_ros.bags.runs.odometry import (
    holes,
    in_words,
    is_within,
    longest_interval,
    overlaps,
    pieces,
)
from cmpsp_ros.bags.runs.run import (
    DrivenPath,
    Passing,
    Run,
    goals_driven_to,
    lifetime,
    mean_speed,
    read_run,
    seen_at,
)
from cmpsp_ros.bags.runs.sensor_clearance import (
    Encounter,
    driven_into,
    encounters,
    robot_encounters,
)
