"""Road, obstacles, goals and robot of a run as a scene for MuJoCo's renderer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Physics, mjcf
from cmpsp_ros.view import Lines
from cmpsp_ros.world.obstacles import Shape

Point = tuple[float, float]

BELOW: Final = -10.0
"""Height of what is not to be seen [m]."""

HEIGHT: Final = 0.12
"""Of obstacles [m]."""

_PURPLE: Final = '0.62 0.2 0.5 1'
_GREEN: Final = '0.05 0.5 0.25 1'
_RED: Final = '0.8 0.25 0.18 1'
_PALE: Final = '0.92 0.62 0.58 1'
_LINE = 0.012

_LOOK = """
  <visual>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.4 0.4 0.4" specular="0 0 0"/>
    <map znear="0.002" zfar="5"/>
    <quality shadowsize="8192" numslices="64"/>
    <global offwidth="1920" offheight="1080"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.95 0.97 1" rgb2="0.55 0.7 0.9"
             width="64" height="384"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.82 0.82 0.8" rgb2="0.74 0.74 0.72"
             width="256" height="256"/>
    <material name="floor" texture="tiles" texrepeat="2 2" texuniform="true"/>
  </asset>
  <worldbody>
    <light pos="0 0 8" dir="0.3 0.2 -1" directional="true" diffuse="0.5 0.5 0.5"/>
    <geom type="plane" size="0 0 1" material="floor"/>"""


def scene(
    settings: GuidanceSettings,
    way: Array,
    goals: Sequence[Point] = (),
    moving: Sequence[int] = (),
    ends: Lines = (),
    hidden: Iterable[Shape] = (),
) -> str:
    """The scene in MuJoCo's own format, with the robot's free joint first.

    Args:
        settings: Robot, road and obstacles.
        way: Points of the driven path, shape ``(K, 2)`` [m].
        goals: Each with a ball `goal 0`, `goal 1`, ... on a post (x, y) [m].
        moving: Ids of the moving obstacles, each a body `moving 7` to be placed later.
        ends: Lines on the floor where the robot starts and ends, each ``(K, 2)`` [m].
        hidden: Obstacles that only the simulator knows.
    """
    posts = (each for index, place in enumerate(goals) for each in _goal(index, place))
    shapes = (*_obstacles(settings.obstacles, _RED), *_obstacles(hidden, _PALE))
    drawn = (*_way(way), *(each for line in ends for each in _way(line)))
    decoration = '\n    '.join((*_edges(settings), *shapes, *drawn, *posts))
    robot = mjcf(settings.robot, Physics(), 0.0) if has_wheels(settings) else _shaped(settings)
    head, rest = robot.split('<worldbody>', 1)
    body = rest.split('/>', 1)[1]  # its floor is a bare one
    discs = ''.join(map(_disc, moving))
    body = body.replace('</worldbody>', f'{discs}</worldbody>', 1)
    return f'{head}{_LOOK}\n    {decoration}{body}'


def has_wheels(settings: GuidanceSettings) -> bool:
    """Whether the robot is shown with its two wheels, and not as its footprint."""
    return isinstance(settings.robot, DifferentialDrive) and not settings.footprint.corners


def _shaped(settings: GuidanceSettings) -> str:
    """A robot of any model, its footprint with a nose, in MuJoCo's own format."""
    radius, height = max(settings.robot_radius, 2.0 * _LINE), HEIGHT / 2.0
    shape, asset = f'type="cylinder" size="{radius!r} {height!r}" pos="0 0 {height!r}"', ''
    if corners := settings.footprint.corners:
        ends = (f'{x!r} {y!r} {z!r}' for x, y in corners for z in (0.0, HEIGHT))
        asset = f'<asset><mesh name="footprint" vertex="{" ".join(ends)}"/></asset>'
        shape = 'type="mesh" mesh="footprint"'
    return f"""<mujoco>
  {asset}
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="robot">
      <freejoint/>
      <geom {shape} mass="1" contype="0" conaffinity="0" rgba="0.12 0.35 0.65 1"/>
      <geom type="box" size="{radius / 2.0!r} {radius / 10.0!r} {height / 4.0!r}" mass="0"
            pos="{radius / 2.0!r} 0 {HEIGHT!r}" contype="0" conaffinity="0" rgba="0.9 0.9 0.9 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def _disc(number: int) -> str:
    """An obstacle that moves, below the floor until it is seen."""
    geom = _geom('cylinder', f'1 {HEIGHT / 2.0}', (0.0, 0.0, 0.0), _PURPLE, f'moving {number}')
    return f'<body name="moving {number}" mocap="true" pos="0 0 {BELOW}">{geom}</body>\n'


def _edges(settings: GuidanceSettings) -> Iterator[str]:
    for edge in settings.road.edges():
        yield from _line(edge, 2.0 * _LINE, '0.25 0.25 0.25 1')


def _obstacles(shapes: Iterable[Shape], color: str) -> Iterator[str]:
    for each in shapes:
        if each.is_disc:
            place = (*each.center, HEIGHT / 2.0)
            yield _geom('cylinder', f'{each.radius} {HEIGHT / 2.0}', place, color)
        else:
            for line in each.outlines(each.radius):
                yield from _line(line, _LINE, color)


def _way(way: Array) -> Iterator[str]:
    # On the floor, not in it: two surfaces at one height take turns from pixel to pixel.
    yield from _line(way, _LINE / 2.0, '0.1 0.35 0.8 1', height=_LINE / 2.0)


def _goal(index: int, place: Point) -> Iterator[str]:
    yield _geom('cylinder', f'0.01 {HEIGHT}', (*place, HEIGHT), _GREEN)
    yield _geom('sphere', '0.05', (*place, 2.0 * HEIGHT), _GREEN, f'goal {index}')


def _line(corners: Array, radius: float, color: str, height: float = 0.0) -> Iterator[str]:
    for (x0, y0), (x1, y1) in pairwise(corners.tolist()):
        if (x0, y0) != (x1, y1):
            ends = f'{x0} {y0} {height} {x1} {y1} {height}'
            yield (
                f'<geom type="capsule" fromto="{ends}" size="{radius}" rgba="{color}" '
                'contype="0" conaffinity="0"/>'
            )


def _geom(
    kind: str, size: str, place: tuple[float, float, float], color: str, name: str = ''
) -> str:
    position, named = ' '.join(map(str, place)), f'name="{name}" ' if name else ''
    return (
        f'<geom {named}type="{kind}" size="{size}" pos="{position}" rgba="{color}" '
        'contype="0" conaffinity="0"/>'
    )
