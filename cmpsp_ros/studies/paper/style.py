"""What the paper's pictures have in common, and files that repeat bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

LIMIT: Final = '0.35'
"""Grey of limits."""

PANELS: Final = ('(a) samples only, as in the paper', '(b) clear between samples too')

_DPI: Final = 200

_PERIOD: Final = 9.0
"""Length of a dash and its gap, in line widths."""


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a picture as PNG and as SVG, without a date.

    Args:
        figure: The picture.
        folder: Where to.
        name: File name without suffix.
    """
    png, svg = folder / f'{name}.png', folder / f'{name}.svg'
    figure.savefig(png, dpi=_DPI, metadata={'Software': None})
    figure.savefig(svg, metadata={'Date': None, 'Creator': None})
    return [png, svg]


def key_above(axes: Axes, lines: Sequence[Artist], columns: int) -> None:
    """A legend in axes of its own, where it cannot cover data."""
    axes.set_axis_off()
    legend = axes.legend(handles=list(lines), loc='center', ncols=columns, borderaxespad=0.0)
    # A wide one would squeeze the pictures below it.
    legend.set_in_layout(False)


def strokes(count: int, *, coincide: bool) -> list[dict[str, Any]]:
    """Strokes for curves that run close to one another, in the order in which they are drawn.

    Args:
        count: How many curves there are.
        coincide: Whether several are the same. They are then dashed so that the colour of each
            shows in turn; otherwise those drawn first are wider.
    """
    if not coincide:
        return [{'lw': 0.9 + 0.8 * (count - 1 - place)} for place in range(count)]
    dashes = [_PERIOD * (count - place) / (count + 1) for place in range(count)]
    return [{'lw': 1.8, 'ls': '-'}] + [
        {'lw': 1.8, 'ls': (0.0, (dash, _PERIOD - dash)), 'dash_capstyle': 'butt'}
        for dash in dashes[1:]
    ]
