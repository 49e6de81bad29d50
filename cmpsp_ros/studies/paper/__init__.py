"""The paper's experiments reproduced: its figures, its tables, and which of its claims hold."""

from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.paper.experiments import table1, table2
from cmpsp_ros.studies.paper.run import ARTEFACTS, run
