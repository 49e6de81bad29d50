"""Pictures of a run from a camera that follows the robot, drawn by MuJoCo."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.audit import read_record
from cmpsp_ros.bags.errors import BagError, written
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.run import driven_in, goals_driven_to, seen_at
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Physics, mjcf
from cmpsp_ros.view import SIGMAS, Lines, Part, bodies, body, course
from cmpsp_ros.world.obstacles import Shape

Point = tuple[float, float]

BELOW: Final = -10.0  # height of what is not to be seen [m]
HEIGHT: Final = 0.12  # height of obstacles [m]
# Height of people up to their shoulders, and of tracks of own sensors [m].
_STATURE, _TRACK = 0.4, 0.02
# Of an arrow.
_TIP = '<asset><mesh name="tip" vertex="0.15 0 0  0 0.08 0  0 -0.08 0  0 0 0.03"/></asset>'
_PURPLE: Final = '0.62 0.2 0.5 1'
_DOUBT: Final = '0.62 0.2 0.5 0.25'
_DARK: Final = '0.35 0.1 0.28 1'
_BROWN: Final = '0.55 0.34 0.2 0.6'
_GREEN: Final = '0.05 0.5 0.25 1'
_LINE, _SHORTEST = 0.012, 1e-6
# Colour, and radius of lines [m], by kind of part.
_PARTS: Final = {
    'edge': ('0.25 0.25 0.25 1', 2.0 * _LINE),
    'obstacle': ('0.8 0.25 0.18 1', _LINE),
    'hidden': ('0.92 0.62 0.58 1', _LINE),
}

_LOOK = """
  <visual>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.4 0.4 0.4" specular="0 0 0"/>
    <map znear="0.002" zfar="5"/>
    <quality shadowsize="4096" numslices="24"/>
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
    people: Sequence[int] = (),
) -> str:
    """The scene in MuJoCo's own format, with the robot's free joint first.

    Of `way` and `ends` each is a line ``(K, 2)`` [m]. Goals are balls `goal 0`, ...; `moving`
    and `people` are ids of bodies `moving 7` and `person 3`, to be placed later.
    """
    posts = [
        geom
        for index, place in enumerate(goals)
        for geom in (
            _geom('cylinder', f'0.01 {HEIGHT}', (*place, HEIGHT), _GREEN),
            _geom('sphere', '0.05', (*place, 2.0 * HEIGHT), _GREEN, f'goal {index}'),
        )
    ]
    parts = course([settings.road], settings.obstacles, hidden)
    # On the floor, not in it: two surfaces at one height take turns from pixel to pixel.
    half, blue = _LINE / 2.0, '0.1 0.35 0.8 1'
    drawn = (_line(each, half, blue, height=half) for each in (way, *ends))
    decoration = '\n    '.join((*_course(parts), *chain.from_iterable(drawn), *posts))
    robot = mjcf(settings.robot, Physics(), 0.0) if has_wheels(settings) else _shaped(settings)
    head, rest = robot.split('<worldbody>', 1)
    body = rest.split('/>', 1)[1]  # its floor is a bare one
    discs = ''.join((*map(_disc, moving), *map(_person, people)))
    body = body.replace('</worldbody>', f'{discs}</worldbody>{_TIP if moving else ""}', 1)
    return f'{head}{_LOOK}\n    {decoration}{body}'


def has_wheels(settings: GuidanceSettings) -> bool:
    """True if the robot is shown with its two wheels, not as its footprint."""
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
    """An obstacle that moves, with its doubt and an arrow, below the floor until it is seen."""
    name = f'moving {number}'
    height = _TRACK if number >= Track.SEEN else HEIGHT
    geoms = (
        _geom('cylinder', f'1 {height / 2.0}', (0.0, 0.0, height / 2.0), _PURPLE, name),
        _geom('cylinder', f'1 {_LINE / 4.0}', (0.0, 0.0, _LINE), _DOUBT, f'{name} doubt'),
        _geom('box', f'1 {2.0 * _LINE} {_LINE}', (0.0, 0.0, height), _DARK, f'{name} way'),
        _geom('mesh', '1', (0.0, 0.0, height), _DARK, f'{name} tip', 'mesh="tip" '),
    )
    return _hidden_body(name, *geoms)


def _person(number: int) -> str:
    """A person of the simulator, below the floor until there is one."""
    name, size = f'person {number}', f'1 {_STATURE / 2.0}'
    return _hidden_body(name, _geom('capsule', size, (0.0, 0.0, _STATURE / 2.0), _BROWN, name))


def _hidden_body(name: str, *geoms: str) -> str:
    return f'<body name="{name}" mocap="true" pos="0 0 {BELOW}">{"".join(geoms)}</body>\n'


def _course(parts: Iterable[Part]) -> Iterator[str]:
    for part in parts:
        color, radius = _PARTS.get(part.kind, ('', 0.0))
        for center, size in part.discs:
            place = (*center, HEIGHT / 2.0)
            yield _geom('cylinder', f'{size} {HEIGHT / 2.0}', place, color)
        for line in part.outlines if color else ():
            yield from _line(line, radius, color)
            yield from _walls(line, color) if part.kind != 'edge' else ()


def _line(corners: Array, radius: float, color: str, height: float = 0.0) -> Iterator[str]:
    for (x0, y0), (x1, y1) in pairwise(corners.tolist()):
        # MuJoCo refuses shorter ones.
        if math.dist((x0, y0), (x1, y1)) > _SHORTEST:
            ends = f'{x0} {y0} {height} {x1} {y1} {height}'
            yield (
                f'<geom type="box" fromto="{ends}" size="{radius}" rgba="{color}" '
                'contype="0" conaffinity="0"/>'
            )


def _walls(corners: Array, color: str) -> Iterator[str]:
    """Sides of an obstacle along its outline."""
    for (x0, y0), (x1, y1) in pairwise(corners.tolist()):
        x, y, length = x1 - x0, y1 - y0, math.dist((x0, y0), (x1, y1))
        if length > _SHORTEST:
            place = (x0 + x1) / 2.0, (y0 + y1) / 2.0, HEIGHT / 2.0
            size = f'{length / 2.0} {_LINE / 2.0} {HEIGHT / 2.0}'
            yield _geom('box', size, place, color, more=f'xyaxes="{x} {y} 0 {-y} {x} 0" ')


def _geom(
    kind: str,
    size: str,
    place: tuple[float, float, float],
    color: str,
    name: str = '',
    more: str = '',
) -> str:
    position, named = ' '.join(map(str, place)), f'name="{name}" ' if name else ''
    return (
        f'<geom {named}{more}type="{kind}" size="{size}" pos="{position}" rgba="{color}" '
        'contype="0" conaffinity="0"/>'
    )


_STILL, _MOVING = (640, 480), (480, 320)
_STILLS, _RATE, _FAINT = 4, 10, 0.3
_WAY_POINTS, _WAY_RATE = 400, 25

# The camera: behind the robot and above it, looking at a point ahead of it.
_DISTANCE, _ELEVATION, _AHEAD, _USUAL_RADIUS = 1.3, -32.0, 0.5, 0.15
_AMONG_PEOPLE, _FROM_ABOVE = 3.0, -45.0


def film(bag: Path, output: Path, seconds: Sequence[float]) -> int:
    """Draw the robot in its scene; return the number of frames.

    A `.png` has the frames side by side, by default four; a `.gif` is in real time, by default
    with ten a second. Raises BagError, also without MuJoCo or its renderer.
    """
    moving = output.suffix == '.gif'
    if output.suffix not in ('.png', '.gif'):
        raise BagError(f"{output}: found the suffix '{output.suffix}', wanted .png or .gif")
    if output.exists():
        raise BagError(f'{output}: is there already')
    record = read_record(bag)
    with Bag(bag) as opened:
        driven = driven_in(opened, '')
    first, settings = record.start, record.history.at(record.start)
    last = int(driven.stamps[-1])
    if not settings.moves_final_time:
        last = min(last, first + to_nanoseconds(settings.final_time))
    length = (last - first) / NANOSECONDS
    if not all(0.0 <= each <= length for each in seconds):
        raise BagError(f'{bag}: found times {seconds} s, wanted times from 0 to {length:.2f} s')
    count = max(2, math.ceil(length * _RATE)) if moving else _STILLS
    times = seconds or np.linspace(0.0, length, count).tolist()
    stamps = [first + to_nanoseconds(each) for each in times]
    corners = max(_WAY_POINTS, math.ceil(length * _WAY_RATE))
    way = [driven.at(int(each))[:2] for each in np.linspace(first, last, corners)]
    led = goals_driven_to(record.decisions, settings)
    goals = list(dict.fromkeys(goal.position for goal in (*settings.goals, *(g for _, g in led))))
    ends = bodies(body(settings), [driven.at(first), driven.at(last)]).lines
    moved, walked = (sorted({each.id for each in some}) for some in (record.tracks, record.people))
    hidden = record.history.epochs[0].hidden
    model = scene(settings, np.array(way), goals, moved, ends, hidden, walked)
    moments = [
        _Moment(
            driven.at(stamp),
            seen_at(record.tracks, stamp, settings),
            next((goals.index(goal.position) for since, goal in led[::-1] if since <= stamp), -1),
            seen_at(record.people, stamp, settings),
        )
        for stamp in stamps
    ]
    frames = list(_frames(model, settings, moments, _MOVING if moving else _STILL))
    with written(output):
        if moving:
            frames[0].save(
                output, save_all=True, append_images=frames[1:], duration=1000 // _RATE, loop=0
            )
        else:
            across, height = frames[0].size
            strip = Image.new('RGB', (across * len(frames), height))
            for index, frame in enumerate(frames):
                strip.paste(frame, (index * across, 0))
            strip.save(output)
    return len(frames)


@dataclass(frozen=True)
class _Moment:
    """Pose ``(3,)`` of the robot, all that moves, and index of the current goal, -1 for none."""

    pose: Array
    moving: list[Track]
    goal: int
    people: list[Track]


def _frames(
    model: str, settings: GuidanceSettings, moments: Sequence[_Moment], size: tuple[int, int]
) -> Iterator[Image.Image]:
    mujoco = _mujoco()
    world = mujoco.MjModel.from_xml_string(model)
    state = mujoco.MjData(world)
    camera = mujoco.MjvCamera()
    two_wheels = has_wheels(settings)
    axle = settings.robot.wheel_radius if two_wheels else 0.0
    # Who is larger is looked at from further away, and who is among people from above them.
    farther = 1.0 if two_wheels else max(1.0, settings.circumscribed_radius / _USUAL_RADIUS)
    has_people = any(each.people for each in moments)
    farther *= _AMONG_PEOPLE if has_people else 1.0
    camera.distance = farther * _DISTANCE
    camera.elevation = _FROM_ABOVE if has_people else _ELEVATION
    width, height = size
    try:
        renderer = mujoco.Renderer(world, height, width)
    except Exception as error:
        # Each of the libraries that it may draw with has errors of its own.
        raise BagError(
            f'MuJoCo cannot draw here (MUJOCO_GL={os.environ.get("MUJOCO_GL", "")}): {error}'
        ) from None
    with renderer:
        for moment in moments:
            x, y, heading = moment.pose.tolist()
            turn = (math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0))
            state.qpos[:7] = (x, y, axle, *turn)
            _arrange(world, state, moment)
            mujoco.mj_forward(world, state)
            reach = farther * _AHEAD
            ahead = (x + reach * math.cos(heading), y + reach * math.sin(heading))
            camera.lookat[:] = (*ahead, axle)
            camera.azimuth = math.degrees(heading)
            renderer.update_scene(state, camera)
            yield Image.fromarray(renderer.render())


def _arrange(world: Any, state: Any, moment: _Moment) -> None:
    state.mocap_pos[:, 2] = BELOW
    for kind, tracks in (('moving', moment.moving), ('person', moment.people)):
        for each in tracks:
            name = f'{kind} {each.id}'
            place, turn = world.body(name).mocapid[0], math.atan2(each.vy, each.vx) / 2.0
            state.mocap_pos[place] = each.x, each.y, 0.0
            state.mocap_quat[place] = math.cos(turn), 0.0, 0.0, math.sin(turn)
            world.geom(name).size[0] = each.radius
            if kind == 'moving':
                reach = each.radius + SIGMAS * each.position_stddev
                world.geom(f'{name} doubt').size[0] = reach
                way, half = world.geom(f'{name} way'), math.hypot(each.vx, each.vy) / 2.0
                way.size[0] = way.pos[0] = max(half, _LINE)
                world.geom(f'{name} tip').pos[0] = 2.0 * half
    for index in range(world.ngeom):
        name = world.geom(index).name
        if name.startswith('goal '):
            world.geom_rgba[index, 3] = 1.0 if name == f'goal {moment.goal}' else _FAINT


def _mujoco() -> Any:
    if 'DISPLAY' not in os.environ:
        # Read on import; the default renderer needs a screen.
        os.environ.setdefault('MUJOCO_GL', 'egl')
    try:
        import mujoco  # noqa: PLC0415 (an option of its own to install)
    except ImportError as error:
        raise BagError(f'this needs the package mujoco (pip install mujoco): {error}') from None
    return mujoco
