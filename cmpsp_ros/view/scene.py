"""Scene of a run: one description for matplotlib, plotly, the film and the markers of RViz."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, LawSettings, World
from cmpsp_ros.guidance.formulation import sample_space
from cmpsp_ros.robots import placed
from cmpsp_ros.world.grids import Cell, OccupancyGrid
from cmpsp_ros.world.obstacles import Point, Shape, outline_of
from cmpsp_ros.world.roads import Road

# Okabe and Ito: Color Universal Design (2008), in an order that also differs in lightness.
BAGS: Final = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#56b4e9', '#000000')

# By fallback level; a stop after the final time is none that should worry anybody.
LEVEL_COLORS: Final = {
    'nominal': '#009e73',
    'elastic': '#f0e442',
    'previous_plan': '#e69f00',
    'stop': '#4d4d4d',
    'arrived': '#c4c9d1',
}

ROAD: Final = '#e9ebef'
EDGE: Final = '#7b8494'
OBSTACLE: Final = '#a63d40'
SEEN: Final = '#e0533d'
UNSEEN: Final = '#b3bbc7'
GOAL: Final = '#1b1f27'
MOVING: Final = '#b03a8c'
PERSON: Final = '#8c5a2b'
MARGIN: Final = '#e69f00'
LIMIT: Final = '#a63d40'
TEXT: Final = '#1b1f27'
GRID: Final = '#e3e6eb'


def bag_color(index: int) -> str:
    """Colour of a bag, by its place on the command line."""
    return BAGS[index % len(BAGS)]


Lines = tuple[Array, ...]

SIGMAS: Final = 2.0  # standard deviations within which a moving obstacle is shown
_WHOLE_MAP: Final = 20.0  # side up to which a map is shown as a whole [m]
# Distance of a shape from the border of a picture that is made larger for it [m].
_BESIDE: Final = 0.1
_MOST_CELLS: Final = 20_000


@dataclass(frozen=True)
class Look:
    """Appearance of a kind of parts."""

    label: str  # name in legends
    color: str  # of lines; empty for that of the run
    fill: str = ''
    width: float = 0.0  # of lines [pt]
    dash: str = 'solid'  # as plotly has it

    @property
    def of_names(self) -> tuple[str, str]:
        """Colour of names, and of the glow around their letters."""
        return ('#ffffff', self.color) if self.fill == self.color else (self.color, '#ffffff')


# By kind, from the lowest to the uppermost.
LOOKS: Final = {
    'road': Look('road', ROAD, ROAD),
    'edge': Look('', EDGE, width=1.0),
    'center line': Look('', EDGE, width=1.0, dash='dot'),
    'obstacle': Look('obstacle', OBSTACLE, OBSTACLE),
    'hidden': Look('obstacle that only the simulator knows', OBSTACLE, '#f2dcdc', 1.0, 'dot'),
    'seen': Look('seen by sensors', SEEN, SEEN),
    'kept clear': Look('kept clear at samples', MARGIN, width=1.0, dash='dash'),
    'moving': Look('path of a moving obstacle', MOVING, width=1.0, dash='dashdot'),
    'tracked': Look('track of a moving obstacle', MOVING, width=0.8, dash='dot'),
    'person': Look('path of a person', PERSON, width=1.0),
    'robot': Look('other robot', TEXT, width=1.2, dash='dot'),
    'trail': Look('', '', width=0.6),
    'body': Look('outline of the robot', '', width=1.4),
}


@dataclass(frozen=True)
class Part:
    """All of one kind, at its place [m]."""

    kind: str
    outlines: Lines  # each ``(K, 2)``, closed where it is filled
    names: tuple[tuple[str, Point], ...] = ()
    discs: tuple[tuple[Point, float], ...] = ()  # solids in a picture of three dimensions

    @property
    def lines(self) -> Lines:
        """All outlines, those of its discs among them."""
        return (*self.outlines, *(outline_of([center], radius) for center, radius in self.discs))

    @property
    def look(self) -> Look:
        """Appearance of its kind."""
        return LOOKS[self.kind]

    @property
    def key(self) -> object:
        """Equal for equal parts."""
        return self.kind, self.names, tuple(each.tobytes() for each in self.lines)


def course(
    roads: Iterable[Road], obstacles: Iterable[Shape], hidden: Iterable[Shape] = ()
) -> tuple[Part, ...]:
    """Roads, obstacles that guidance knows, and those that only the simulator knows."""
    parts = [part for road in roads for part in _road(road)]
    for kind, shapes in (('obstacle', list(obstacles)), ('hidden', list(hidden))):
        others = (each for each in shapes if not each.is_disc)
        lines = tuple(line for each in others for line in each.outlines(each.radius))
        names = tuple((each.name, each.center) for each in shapes if each.corners)
        discs = tuple((each.center, each.radius) for each in shapes if each.is_disc)
        parts.append(Part(kind, lines, names, discs))
    return tuple(each for each in parts if each.lines)


def kept_clear(settings: LawSettings, world: World) -> Part:
    """Minimum distance of the centres of the robot's discs from each obstacle at samples."""
    radii = zip(world.shapes, sample_space(settings, world).radii.tolist(), strict=True)
    return Part('kept clear', tuple(line for each, r in radii for line in each.outlines(r)))


def seen(grids: Sequence[OccupancyGrid]) -> Part:
    """All cells that were occupied in any of some grids on one lattice, once each."""
    cells = set[tuple[int, int]]()
    if not grids:
        return Part('seen', ())
    for each in grids:
        rows, columns = grids[0].indices(each.centers(*np.nonzero(each.cells == Cell.OCCUPIED)))
        cells.update(zip(rows.tolist(), columns.tolist(), strict=True))
    found = np.array(sorted(cells)[:_MOST_CELLS], dtype=float).reshape(-1, 1, 2)
    corners = found + np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0, 0]])
    return Part('seen', tuple(grids[0].corners(*corners.T).swapaxes(0, 1)) if len(found) else ())


def disc(radius: float) -> Lines:
    """Outline of a round robot, and a line from its centre to its front; none of a point."""
    return _with_nose(outline_of([(0.0, 0.0)], radius)) if radius > 0.0 else ()


def body(settings: GuidanceSettings) -> Lines:
    """Outline of the robot, and a line to its front, in its own frame; none of a point."""
    corners = settings.footprint.corners
    return _with_nose(np.array([*corners, corners[0]])) if corners else disc(settings.robot_radius)


def bodies(outline: Lines, poses: Iterable[Array], kind: str = 'body') -> Part:
    """A robot at some poses ``(x, y, heading)`` [m, m, rad]."""
    return Part(kind, tuple(placed(line, pose) for pose in poses for line in outline))


def trail(settings: GuidanceSettings, poses: Array) -> Part:
    """Outlines of a robot that has corners, a length apart along a path ``(N, 3)``."""
    if not settings.footprint.corners:
        return Part('trail', ())
    apart = float(np.ptp(settings.footprint.corners, axis=0).max())
    steps = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]).T)
    _, chosen = np.unique(np.cumsum(steps) // apart, return_index=True)
    return bodies(body(settings)[:1], poses[chosen], 'trail')


def frame(points: Sequence[Array], shapes: Iterable[Shape], room: float) -> tuple[Array, Array]:
    """Corners of a picture ``(2,)``, `room` around points [m]; obstacles are in it whole or not."""
    every = np.vstack(points)
    low, high = every.min(axis=0) - room, every.max(axis=0) + room
    lines = [line for each in shapes if each.corners for line in each.outlines(each.radius)]
    boxes = np.array([(line.min(axis=0), line.max(axis=0)) for line in lines]).reshape(-1, 2, 2)
    boxes += np.array([[-_BESIDE], [_BESIDE]])
    while True:
        met = boxes[((boxes[:, 0] < high) & (boxes[:, 1] > low)).all(axis=1)].reshape(-1, 2)
        corners = np.vstack([low, high, met])
        if not ((corners < low) | (corners > high)).any():
            return low, high
        low, high = corners.min(axis=0), corners.max(axis=0)


def map_corners(settings: GuidanceSettings) -> Array:
    """Corners of the map ``(4, 2)`` [m]; none if it is so large that a path would be lost on it."""
    known = settings.world.map
    if known is None or max(known.grid.size) > _WHOLE_MAP:
        return np.empty((0, 2))
    return known.grid.ends


def _road(road: Road) -> list[Part]:
    parts = [('road', [road.area()]), ('edge', road.edges()), ('center line', [road.center_line()])]
    return [Part(kind, tuple(each for each in lines if len(each))) for kind, lines in parts]


def _with_nose(outline: Array) -> Lines:
    return outline, np.array([[0.0, 0.0], [float(outline[:, 0].max()), 0.0]])
