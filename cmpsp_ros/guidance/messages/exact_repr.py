"""Values as text that reads back as they were."""

from __future__ import annotations


def written(value: object) -> str:
    """A value as text: floats read back bit for bit, truth is `true` or `false`."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return repr(float(value)) if isinstance(value, float) else str(value)
