"""Obstacles, at rest and moving, and exact distances from them."""
