"""ROS messages as the law takes them and as it is written down; nothing here imports ROS."""
