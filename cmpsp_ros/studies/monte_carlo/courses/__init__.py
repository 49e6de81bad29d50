"""Courses of studies, drawn by seed and number: rings, corridors, rooms, and places with people."""
