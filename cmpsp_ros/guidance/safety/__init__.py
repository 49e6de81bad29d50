"""Safety checks on every command."""

from cmpsp_ros.guidance.safety.command_changes import CHANGE_ROUNDING
from cmpsp_ros.guidance.safety.plan_clearance import plan_clearance
from cmpsp_ros.guidance.safety.validation import Validator
