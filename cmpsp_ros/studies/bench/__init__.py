"""How long things take: control steps, beside other solvers, over horizons and over DDS."""

from cmpsp_ros.studies.bench.errors import BenchError
from cmpsp_ros.studies.bench.results import Order
from cmpsp_ros.studies.bench.run import run
from cmpsp_ros.studies.bench.tables import tables

__all__ = ['BenchError', 'Order', 'run', 'tables']
