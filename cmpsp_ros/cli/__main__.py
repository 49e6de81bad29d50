"""`python -m cmpsp_ros.cli` is `cmpsp`."""

from cmpsp_ros.programs import cmpsp

cmpsp()
