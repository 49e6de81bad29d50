"""Safety checks on every command."""

from cmpsp_ros.guidance.safety.plan_sweep import plan_clearance
from cmpsp_ros.guidance.safety.validation import CHANGE_ROUNDING, Validator
