"""What people are shown: the live page, and colours and drawing for all pictures; no ROS in it."""
