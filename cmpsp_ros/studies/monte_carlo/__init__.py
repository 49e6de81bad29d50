"""Monte Carlo studies: many random courses, driven by the guidance law and the plant alone."""

from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.monte_carlo.eyes import Eyes
from cmpsp_ros.studies.monte_carlo.kinds import KINDS
from cmpsp_ros.studies.monte_carlo.run import Order, run, run_one
from cmpsp_ros.studies.monte_carlo.study import MOST_OBSTACLES, Study
from cmpsp_ros.studies.monte_carlo.summary import tables
