"""Everything that knows ROS: the nodes, their messages and their parameters."""

import os

# Matrices here are small: a second thread of the linear algebra gains nothing and may wait for a
# core for a hundred milliseconds. To have an effect it must be said before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
