"""Bags: writing, reading, replay, audit and report, without rclpy."""
