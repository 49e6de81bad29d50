"""Compiles what nodes and commands run, before they do, and tells how fast a computer is."""

from cmpsp_ros.warmup.kernels import warm_up_all
from cmpsp_ros.warmup.process_pool import new_pool
from cmpsp_ros.warmup.work_rate import work_rate
