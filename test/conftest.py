"""What holds for all tests."""

from __future__ import annotations

from hypothesis import settings

# No test by examples is about time, and the first example may compile.
settings.register_profile('unhurried', deadline=None)
settings.load_profile('unhurried')
