"""Outputs of the guidance node."""
