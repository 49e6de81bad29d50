"""The live page, and colours and drawing for all pictures; without ROS."""
