"""Everything that knows ROS: the nodes, their messages and their parameters."""

import gc
import os
from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.nodes.common.interruptions import interruptions_held
    from cmpsp_ros.nodes.lifecycle_client import GuidanceStatus, LifecycleClient

__getattr__, __all__ = lazy_exports(__name__, __file__)

# Matrices here are small: a second thread of the linear algebra gains nothing and may wait for a
# core for a hundred milliseconds. To have an effect it must be said before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# Importing makes many objects that stay: a tenth of a node's start would go into looking through
# them again and again.
gc.set_threshold(max(gc.get_threshold()[0], 100_000))

# Modules of the programs, by the names that `ros2 run` has for them.
MODULES = {
    'guidance_node': 'cmpsp_ros.nodes.guidance.node',
    'sim_node': 'cmpsp_ros.nodes.sim.node',
    'recorder': 'cmpsp_ros.nodes.recording.recorder',
    'viewer': 'cmpsp_ros.nodes.viewer',
}
