"""Timings with the real nodes, in processes of their own."""
