"""Occupied, free and unknown cells: grids, files of them, and the distance to what is occupied."""
