"""Shared by the nodes: lifecycle, topics, parameters and health."""
