"""Scenes as traces in plotly's terms, plain data for its script and for `drawing`."""

import base64
import io
import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any, Final

import numpy as np
from PIL import Image

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import Goal
from cmpsp_ros.view.scene import GOAL, SEEN, UNSEEN, Lines, Part
from cmpsp_ros.world.grids import Cell, OccupancyGrid

_MOST: Final = 256  # pixels along a side at most

# Free, unknown and occupied cells by rank: the highest in a pixel is drawn.
_RANKS: Final = np.zeros(len(Cell), dtype=np.uint8)
_RANKS[[Cell.UNKNOWN, Cell.OCCUPIED]] = 1, 2
_COLORS: Final = bytes.fromhex(''.join(each[1:] for each in ('#ffffff', UNSEEN, SEEN)))
_OPACITY: Final = bytes([0, 255, 255])


def grid_picture(grid: OccupancyGrid) -> dict[str, Any]:
    """Picture of a grid along the axes: ``x``, ``y``, ``width``, ``height`` [m] and data URL.

    Free and remembered cells are transparent. Of several in a pixel an occupied one is shown.
    """
    high, wide = grid.cells.shape
    step = math.ceil(max(high, wide) / _MOST)
    pixels = np.maximum.reduceat(_RANKS[grid.cells], np.arange(0, high, step), axis=0)
    pixels = np.maximum.reduceat(pixels, np.arange(0, wide, step), axis=1)
    image = Image.fromarray(pixels[::-1], 'P')
    image.putpalette(_COLORS)
    file = io.BytesIO()
    image.save(file, 'PNG', transparency=_OPACITY, bits=2)
    # The last pixels may stand for fewer cells: the picture reaches beyond the grid by them.
    width, height = (step * grid.resolution * count for count in pixels.shape[::-1])
    left, bottom, _ = grid.origin
    return {
        'x': round(left, 6),
        'y': round(bottom + height, 6),
        'width': round(width, 6),
        'height': round(height, 6),
        'source': f'data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}',
    }


Trace = dict[str, Any]

_DIGITS: Final = 6  # digits after the point: a micrometre, a microsecond
_NONE: Final = np.zeros(0)


def traces(parts: Iterable[Part], color: str) -> list[Trace]:
    """Lines of each part as a trace, and its names as another, with the color of the run."""
    found = []
    for part in parts:
        look = part.look
        line = {'color': look.color or color, 'width': 1.2 * look.width, 'dash': look.dash}
        filled = {'fill': 'toself', 'fillcolor': look.fill} if look.fill else {}
        x, y = coordinates(part.lines)
        shown = {'x': x, 'y': y, 'line': line, 'showlegend': bool(look.label and x)}
        found.append(trace(look.label, 'lines') | filled | shown)
        if part.names:
            inside, around = look.of_names
            glow = ', '.join([f'0 0 2px {around}'] * 4)
            font = {'color': inside, 'size': 13, 'shadow': glow}
            texts = {'text': [escape(name) for name, _ in part.names], 'textfont': font}
            names = trace('names', 'text', *np.array([at for _, at in part.names]).T)
            found.append(names | texts | {'showlegend': False})
    return found


def ends(poses: Array, color: str) -> Trace:
    """The first and the last of poses ``(N, 3)`` as triangles that point ahead."""
    chosen = poses[[-1, 0]]
    return trace('start and end', 'markers', *chosen[:, :2].T) | arrow(chosen[:, 2], color, 12)


def goals_trace(goals: Sequence[Goal]) -> Trace:
    """Goals as stars with their names."""
    shown = trace('goal' if len(goals) == 1 else 'goals', 'markers+text')
    x, y = np.array([goal.position for goal in goals]).reshape(-1, 2).T
    marker = {'symbol': 'star', 'size': 22, 'color': GOAL}
    shown |= {'x': numbers(x), 'y': numbers(y), 'marker': marker, 'showlegend': bool(goals)}
    shown |= hover([escape(goal.name) for goal in goals])
    shown['hovertemplate'] = f'goal {shown["hovertemplate"]}'
    return shown | {'textposition': 'top right', 'cliponaxis': False}


def trace(name: str, mode: str, x: Array = _NONE, y: Array = _NONE) -> Trace:
    """A trace that answers no mouse."""
    shown = {'type': 'scatter', 'name': name, 'mode': mode, 'hoverinfo': 'skip'}
    return shown | {'x': numbers(x), 'y': numbers(y)}


def hover(texts: Sequence[str]) -> Trace:
    """Hover texts, one for each point."""
    shown = {'hovertemplate': '%{text}: %{x:.3f}, %{y:.3f} m<extra></extra>', 'hoverinfo': 'all'}
    return {'text': list(texts), **shown}


def arrow(headings: Array, color: str, size: int) -> Trace:
    """Markers of robots with some headings [rad]."""
    white, angles = {'color': '#ffffff', 'width': 1.5}, numbers(90.0 - np.degrees(headings))
    look = {'symbol': 'triangle-up', 'size': size, 'angle': angles, 'color': color, 'line': white}
    return {'marker': look}


def coordinates(lines: Lines) -> tuple[list[float | None], list[float | None]]:
    """X and y of lines, with a gap between each two of them."""
    gap = np.full((1, 2), np.nan)
    every = np.vstack([point for line in lines for point in (line, gap)] or [gap])[:-1]
    return numbers(every[:, 0]), numbers(every[:, 1])


def number(value: float) -> float | None:
    """A number for JSON, which knows no NaN."""
    return round(float(value), _DIGITS) if math.isfinite(value) else None


def numbers(values: Array) -> list[float | None]:
    """Numbers for JSON."""
    return [number(each) for each in values.tolist()]
