"""The paper's experiments, made again: its figures, its tables, and what holds of its claims."""

from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.paper.run import ARTEFACTS, run

__all__ = ['ARTEFACTS', 'StudyError', 'run']
