"""The live view: what a browser is shown of a running system, and how; no ROS in it."""
