"""Experiments on the guidance law without ROS."""
