"""Colours that colour-blind readers can distinguish, also in grey."""

from __future__ import annotations

from typing import Final

# Okabe and Ito: Color Universal Design (2008), in an order that also differs in lightness.
BAGS: Final = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#56b4e9', '#000000')

LEVEL_COLORS: Final = {
    'nominal': '#009e73',
    'elastic': '#f0e442',
    'previous_plan': '#e69f00',
    'stop': '#4d4d4d',
    'arrived': '#c4c9d1',
}
"""By fallback level; a stop after the final time is none that should worry anybody."""

ROAD: Final = '#e9ebef'
EDGE: Final = '#7b8494'
OBSTACLE: Final = '#a63d40'
SEEN: Final = '#e0533d'
UNSEEN: Final = '#b3bbc7'
GOAL: Final = '#1b1f27'
MOVING: Final = '#b03a8c'
MARGIN: Final = '#e69f00'
LIMIT: Final = '#a63d40'
TEXT: Final = '#1b1f27'
GRID: Final = '#e3e6eb'


def bag_color(index: int) -> str:
    """Colour of a bag, by its place on the command line."""
    return BAGS[index % len(BAGS)]
