"""The paper's experiments reproduced: its figures, its tables, and which of its claims hold."""

from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.paper.run import ARTEFACTS, run

__all__ = ['ARTEFACTS', 'StudyError', 'run']
