"""From a pose to the best plan: guesses, iterations, and the choice among candidates."""

from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.planning.grid_path_memory import search_ahead
from cmpsp_ros.guidance.planning.initial_trajectories import along_road, initial_guess
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.reeds_shepp import manoeuvres
