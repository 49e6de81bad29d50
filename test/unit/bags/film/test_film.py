"""A run in its scene: what is there, where the robot is, and what cannot be drawn."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.film import film, scene
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.sensing import Track
from cmpsp_ros.view import bodies, body
from cmpsp_ros.world.obstacles import Obstacle

mujoco = pytest.importorskip('mujoco')

DRAW = (
    "import mujoco; model = mujoco.MjModel.from_xml_string('<mujoco/>');"
    'mujoco.Renderer(model, 8, 8).close()'
)


def can_draw():
    """Tried in a process of its own: some libraries end it where there is nothing to draw with."""
    env = {**os.environ, 'MUJOCO_GL': os.environ.get('MUJOCO_GL', 'egl')}
    command = [sys.executable, '-c', DRAW]
    return not subprocess.run(command, env=env, capture_output=True, check=False).returncode


@pytest.fixture(scope='module')
def drawing(bag):
    """A command that draws: `drawing(*arguments)`."""
    if not can_draw():
        pytest.skip('nothing to draw with: no EGL')

    def run(*arguments):
        command = [sys.executable, '-m', 'cmpsp_ros.cli', 'film', *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    return run


def lines_in(model):
    """True for pieces of lines: they are as high as they are wide."""
    is_square = model.geom_size[:, 0] == model.geom_size[:, 1]
    return (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & is_square & (model.geom_bodyid == 0)


def test_the_scene_has_road_obstacles_goal_way_and_robot():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    way = np.array([[0.0, -9.25], [1.0, -9.0], [1.0, -9.0], [2.0, -8.5]])
    text = scene(settings, way, [settings.goal, (1.0, 2.0)], moving=[3, 7])
    model = mujoco.MjModel.from_xml_string(text)
    assert model.body('robot').id == 1
    assert model.nq == 7 + 2
    assert [model.body(f'moving {number}').mocapid[0] for number in (3, 7)] == [0, 1]
    assert model.geom('goal 1').pos[:2].tolist() == [1.0, 2.0]
    kinds, size, place = model.geom_type, model.geom_size, model.geom_pos
    in_world = model.geom_bodyid == 0
    discs = (kinds == mujoco.mjtGeom.mjGEOM_CYLINDER) & in_world
    there = {(*place[i, :2].tolist(), float(size[i, 0])) for i in np.flatnonzero(discs)}
    assert {(*each.center, each.radius) for each in settings.obstacles} < there
    assert settings.goal in {each[:2] for each in there}
    lines = lines_in(model)
    distances = np.hypot(*place[lines, :2].T)
    for edge in settings.road.edges():
        radius = np.hypot(*edge[0])
        assert (np.abs(distances - radius) < 2e-3).sum() == len(edge) - 1
    # Two pieces of the way have a length, one has none.
    assert lines.sum() == 2 * (len(edge) - 1) + 2


def test_what_moves_has_its_doubt_and_its_way_and_people_stand_up():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    way, seen = np.array([[0.0, -9.25], [1e-9, -9.25], [1.0, -9.0]]), Track.SEEN + 1
    text = scene(settings, way, moving=[7, seen], people=[0])
    model = mujoco.MjModel.from_xml_string(text)
    for number, height in ((7, 0.12), (seen, 0.02)):
        name = f'moving {number}'
        assert 2.0 * model.geom(name).size[1] == pytest.approx(height)
        assert model.geom(f'{name} doubt').rgba[3] < 0.5
        assert model.geom(f'{name} way').bodyid == model.body(name).id
    assert model.geom('person 0').type == mujoco.mjtGeom.mjGEOM_CAPSULE
    assert model.body('person 0').mocapid[0] == 2


def test_where_it_starts_and_ends_is_on_the_floor_and_hidden_obstacles_are_pale():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('parking')))
    way = np.array([[0.0, 0.0], [1.0, 0.0]])
    ends = bodies(body(settings), [np.zeros(3), np.array([1.0, 0.0, 0.0])]).lines
    crate = Obstacle('crate', (5.0, 5.0), 0.4)
    plain, shown = (
        mujoco.MjModel.from_xml_string(scene(settings, way, [], [], *more))
        for more in ((), (ends, [crate]))
    )
    # Four sides and a line to the front, twice.
    assert lines_in(shown).sum() - lines_in(plain).sum() == 10
    (index,) = np.flatnonzero(shown.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER)
    assert shown.geom_pos[index, :2].tolist() == [5.0, 5.0]
    assert shown.geom_rgba[index].tolist() == pytest.approx([0.92, 0.62, 0.58, 1.0])


@pytest.mark.parametrize('preset', ['parking', 'slot'])
def test_a_robot_with_corners_is_a_prism(preset):
    settings = guidance_settings(TABLE.resolve(load_parameter_file(preset)))
    model = mujoco.MjModel.from_xml_string(scene(settings, np.zeros((2, 2)), [settings.goal]))
    (body,) = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    corners = model.mesh_vert @ state.geom_xmat[body].reshape(3, 3).T + state.geom_xpos[body]
    found = np.unique(corners[:, :2].round(4), axis=0)
    np.testing.assert_allclose(found, np.unique(settings.footprint.corners, axis=0), atol=1e-4)


@pytest.mark.slow
def test_stills_show_the_robot_beside_the_obstacle_and_at_the_goal(drawing, bag, tmp_path):
    path = tmp_path / 'film.png'
    done = drawing(bag, '--output', path, '--at', 6.2, '--at', 9.9)
    assert (done.returncode, done.stdout) == (0, f'{path}: 2 frames\n'), done.stderr
    picture = np.asarray(Image.open(path)).astype(int)
    assert picture.shape == (480, 2 * 640, 3)
    beside, arriving = picture[:, :640], picture[:, 640:]

    def share(frame, color):
        """Part of the pixels in which one colour rules."""
        rest = [k for k in range(3) if k != color]
        return (frame[..., color] > frame[..., rest].max(axis=-1) + 60).mean()

    red, green, blue = range(3)
    assert share(beside, red) > 0.1
    assert share(arriving, red) < 0.01
    assert share(arriving, green) > 1e-3
    assert min(share(beside, blue), share(arriving, blue)) > 5e-3


@pytest.mark.slow
def test_a_film_moves_in_real_time(drawing, bag, tmp_path):
    path = tmp_path / 'film.gif'
    done = drawing(bag, '--output', path, *(f'--at={t}' for t in (1.0, 1.1, 1.2)))
    assert done.returncode == 0, done.stderr
    with Image.open(path) as film_:
        assert film_.n_frames == 3
        assert film_.info['duration'] == 100
        first = np.asarray(film_.convert('RGB')).astype(int)
        film_.seek(2)
        assert np.abs(np.asarray(film_.convert('RGB')).astype(int) - first).max() > 50


@pytest.mark.parametrize(
    ('name', 'seconds', 'text'),
    [
        ('film.jpg', [], "found the suffix '.jpg', wanted .png or .gif"),
        ('there.png', [], 'there.png: is there already'),
        ('film.png', [10.5], r'wanted times from 0 to 10.00 s'),
        ('film.png', [1.0, -0.1], r'wanted times from 0 to 10.00 s'),
        ('film.png', [math.nan], r'wanted times from 0 to 10.00 s'),
    ],
)
def test_what_cannot_be_is_told(bag, tmp_path, name, seconds, text):
    (tmp_path / 'there.png').touch()
    with pytest.raises(BagError, match=text):
        film(bag, tmp_path / name, seconds)
    assert [each.name for each in tmp_path.iterdir()] == ['there.png']
    assert (tmp_path / 'there.png').stat().st_size == 0


def test_what_is_no_bag_is_told(tmp_path):
    with pytest.raises(BagError, match='not a bag'):
        film(tmp_path, tmp_path / 'film.png', [])


def test_without_mujoco_it_says_what_to_install(bag, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    with pytest.raises(BagError, match='pip install mujoco'):
        film(bag, tmp_path / 'film.png', [1.0])
