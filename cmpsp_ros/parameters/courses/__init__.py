"""Courses from parameters: road, map, obstacles and goals, and their checks."""
