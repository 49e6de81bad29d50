"""The paper's experiments reproduced: its figures, its tables, and which of its claims hold."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.studies.common import StudyError
    from cmpsp_ros.studies.paper.artefacts import ARTEFACTS, run
    from cmpsp_ros.studies.paper.drives import Path
    from cmpsp_ros.studies.paper.experiments import table1, table2
    from cmpsp_ros.studies.paper.ipopt import motion, reference_solution
    from cmpsp_ros.studies.paper.starts import run_starts

__getattr__, __all__ = lazy_exports(__name__, __file__)
