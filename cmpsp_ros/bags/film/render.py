"""Pictures of a run from a camera that follows the robot."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.audit import read_record
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.film.scene import BELOW, HEIGHT, has_wheels, scene
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.node_parameters import hidden_obstacles
from cmpsp_ros.bags.runs.goals import goals_driven_to
from cmpsp_ros.bags.runs.run import read_driven, seen_at
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.view import bodies, body

_STILL, _MOVING = (640, 480), (480, 320)
_STILLS, _RATE = 4, 10
_FAINT = 0.3
_WAY_POINTS, _WAY_RATE = 400, 25

# The camera: behind the robot and above it, looking at a point ahead of it.
_DISTANCE, _ELEVATION, _AHEAD = 1.3, -32.0, 0.5
_USUAL_RADIUS = 0.15


def film(bag: Path, output: Path, seconds: Sequence[float]) -> int:
    """Draw the robot in its scene.

    Args:
        bag: Bag of one run.
        output: New picture: a `.png` with its frames side by side, or a `.gif` that moves, in real
            time.
        seconds: Times of the frames [s]; when empty, four for a `.png` and ten a second for a
            `.gif`.

    Returns:
        How many frames there are.

    Raises:
        BagError: The bag cannot be used, a time is not in it, MuJoCo or what it draws with is
            missing, or the picture cannot be written.
        ParameterError: The bag's parameters cannot be used.
    """
    moving = output.suffix == '.gif'
    if output.suffix not in ('.png', '.gif'):
        raise BagError(f"{output}: found the suffix '{output.suffix}', wanted .png or .gif")
    if output.exists():
        raise BagError(f'{output}: is there already')
    record, driven = read_record(bag), read_driven(bag)
    first, settings = record.start, record.history.at(record.start)
    last = min(int(driven.stamps[-1]), first + to_nanoseconds(settings.final_time))
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
    moved = sorted({each.id for each in record.tracks})
    ends = bodies(body(settings), [driven.at(first), driven.at(last)]).lines
    with Bag(bag) as opened:
        hidden = hidden_obstacles(opened, record.places.node)
    model = scene(settings, np.array(way), goals, moved, ends, hidden)
    moments = [
        _Moment(
            driven.at(stamp),
            seen_at(record.tracks, stamp, settings.moving_obstacles.timeout),
            next((goals.index(goal.position) for since, goal in led[::-1] if since <= stamp), -1),
        )
        for stamp in stamps
    ]
    frames = list(_frames(model, settings, moments, _MOVING if moving else _STILL))
    try:
        if moving:
            frames[0].save(
                output, save_all=True, append_images=frames[1:], duration=1000 // _RATE, loop=0
            )
        else:
            _side_by_side(frames).save(output)
    except OSError as error:
        raise BagError(f'{output}: {error.strerror or error}') from None
    return len(frames)


@dataclass(frozen=True)
class _Moment:
    """The data that change from frame to frame.

    Attributes:
        pose: Of the robot, shape ``(3,)`` [m, m, rad].
        moving: Moving obstacles at that time.
        goal: Index of the current goal, -1 for none.
    """

    pose: Array
    moving: list[Track]
    goal: int


def _frames(
    model: str, settings: GuidanceSettings, moments: Sequence[_Moment], size: tuple[int, int]
) -> Iterator[Image.Image]:
    mujoco = _mujoco()
    world = mujoco.MjModel.from_xml_string(model)
    state = mujoco.MjData(world)
    camera = mujoco.MjvCamera()
    two_wheels = has_wheels(settings)
    axle = settings.robot.wheel_radius if two_wheels else 0.0
    # Who is larger is looked at from further away.
    farther = 1.0 if two_wheels else max(1.0, settings.circumscribed_radius / _USUAL_RADIUS)
    camera.distance, camera.elevation = farther * _DISTANCE, _ELEVATION
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
    """Place the moving obstacles, and highlight the current goal."""
    state.mocap_pos[:, 2] = BELOW
    for each in moment.moving:
        name = f'moving {each.id}'
        world.geom(name).size[0] = each.radius
        state.mocap_pos[world.body(name).mocapid[0]] = (each.x, each.y, HEIGHT / 2.0)
    names = [world.geom(index).name for index in range(world.ngeom)]
    for index, name in enumerate(names):
        if name.startswith('goal '):
            world.geom_rgba[index, 3] = 1.0 if name == f'goal {moment.goal}' else _FAINT


def _mujoco() -> Any:
    if 'DISPLAY' not in os.environ:
        # Read when it is imported; what it draws with by itself wants a screen.
        os.environ.setdefault('MUJOCO_GL', 'egl')
    try:
        import mujoco  # noqa: PLC0415 (an option of its own to install)
    except ImportError as error:
        raise BagError(f'this needs the package mujoco (pip install mujoco): {error}') from None
    return mujoco


def _side_by_side(frames: list[Image.Image]) -> Image.Image:
    width, height = frames[0].size
    strip = Image.new('RGB', (width * len(frames), height))
    for index, frame in enumerate(frames):
        strip.paste(frame, (index * width, 0))
    return strip
