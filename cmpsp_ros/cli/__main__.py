"""`python -m cmpsp_ros.cli` is `cmpsp`."""

from cmpsp_ros.cli import main

main()
