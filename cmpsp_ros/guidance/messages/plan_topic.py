"""Where robots publish their plans, for those that keep clear of each other."""

from __future__ import annotations


def plan_topic(namespace: str) -> str:
    """Where a robot publishes its plans."""
    return f'{namespace}/guidance/predicted_path'
