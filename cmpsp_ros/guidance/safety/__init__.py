"""What no command leaves without."""

from cmpsp_ros.guidance.safety.audit import CHANGE_ROUNDING, Audit
from cmpsp_ros.guidance.safety.plan_clearance import plan_clearance
