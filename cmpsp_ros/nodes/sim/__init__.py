"""The simulator as a node."""
