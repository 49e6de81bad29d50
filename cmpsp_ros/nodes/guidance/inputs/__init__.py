"""Inputs of the guidance node."""
