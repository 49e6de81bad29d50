"""Families of random programs, on which back ends are verified."""
