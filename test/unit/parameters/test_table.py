"""The table: a whole set is read at once, and all that is wrong with it is said."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cmpsp_ros.parameters import TABLE, ParameterError
from cmpsp_ros.parameters.parameter import REQUIRED

OBSTACLE = {'obstacles.a.center': [8.0, -6.0], 'obstacles.a.radius': 0.7}


def refusal(values):
    with pytest.raises(ParameterError) as caught:
        TABLE.resolve(values)
    return str(caught.value).splitlines()


@pytest.mark.parametrize('row', list(TABLE), ids=lambda row: row.name)
def test_each_row_is_whole(row):
    assert row.nodes <= {'guidance', 'sim'}
    assert row.nodes
    assert row.description.endswith('.')
    assert row.default is REQUIRED or row.read('key', row.default) == row.default


def test_defaults_fill_an_empty_set_in_the_order_of_the_table():
    values = TABLE.resolve({})
    assert list(values) == [row.name for row in TABLE if not row.is_block]
    assert TABLE.resolve(values) == values


def test_blocks_stand_together_behind_their_names():
    second = {'obstacles.b.radius': 1, 'obstacles.b.center': np.array([1, 2])}
    values = TABLE.resolve({**second, **OBSTACLE, 'obstacles.names': ('b', 'a')})
    keys = list(values)
    start = keys.index('obstacles.names')
    block = ['type', 'center', 'radius', 'start', 'end', 'vertices']
    assert keys[start + 1 : start + 13] == [
        f'obstacles.{name}.{key}' for name in ('b', 'a') for key in block
    ]
    assert values['obstacles.b.center'] == [1.0, 2.0]


@pytest.mark.parametrize(
    ('values', 'lines'),
    [
        ({'goal.tolerance': -1, 'frame_id': 3, 'odom_timout': 1.0, 'solver.qp': 'daqp'},
         ['frame_id: found 3, wanted text, not empty (put it in quotes to make it text)',
          'goal.tolerance: found -1, wanted a number > 0 [m]',
          'odom_timout: found an unknown parameter, wanted a known one (did you mean'
          ' odom_timeout?)']),
        ({**OBSTACLE, 'obstacles.names': ['a'], 'obstacles.a.radius': -0.5},
         ['obstacles.a.radius: found -0.5, wanted a number >= 0 [m]']),
        ({'moving_obstacles.names': ['a']},
         ['moving_obstacles.a.center: found nothing, wanted a list of 2 numbers [m]',
          'moving_obstacles.a.velocity: found nothing, wanted a list of 2 numbers [m/s]',
          'moving_obstacles.a.radius: found nothing, wanted a number > 0 [m]']),
        (OBSTACLE,
         [f'{key}: found a block that is not listed, wanted a name listed in obstacles.names []'
          for key in OBSTACLE]),
        ({**OBSTACLE, 'obstacles.names': ['a', 'a']},
         ["obstacles.names: found ['a', 'a'], wanted a list of different names"]),
        ({1: 2, 'a\nb': 3},
         ["1: found no text, wanted a parameter's name",
          r"'a\nb': found an unknown parameter, wanted a known one"]),
    ],
)  # fmt: skip
def test_all_problems_are_reported_together(values, lines):
    assert refusal(values) == lines


@pytest.mark.parametrize('name', ['1a', 'a.b', 'a b', '-', 'é', 'names', '<name>', '_a'])
def test_a_name_that_cannot_be_part_of_a_parameter_name(name):
    given_ = {
        'obstacles.names': [name],
        f'obstacles.{name}.center': [0.0, 0.0],
        f'obstacles.{name}.radius': 1.0,
    }
    (line,) = refusal(given_)
    wanted = 'another name: obstacles.names is' if name == 'names' else 'a name of letters'
    assert line.startswith(f"obstacles.names: found '{name}', wanted {wanted}")


@pytest.mark.parametrize(
    ('key', 'hint'),
    [
        ('weights.road_centre', ' (did you mean weights.road_center?)'),
        ('obstacles.c.centre', ' (did you mean obstacles.c.center?)'),
        ('sim.obstacle.bin.center', ' (did you mean sim.obstacles.bin.center?)'),
        ('obstacle.a.center', ' (did you mean obstacles.a.center?)'),
        ('waypoint.b.position', ' (did you mean waypoints.b.position?)'),
        ('obstacles', ' (did you mean obstacles.names?)'),
        ('zzz', ''),
    ],
)
def test_an_unknown_key_gets_the_nearest_known_one(key, hint):
    assert refusal({key: 1.0}) == [f'{key}: found an unknown parameter, wanted a known one{hint}']


@pytest.mark.parametrize(
    'key', ['use_sim_time', 'start_type_description_service', 'qos_overrides./odom.reliability']
)
def test_parameters_of_ros_itself_are_left_out(key):
    assert TABLE.resolve({key: object()}) == TABLE.resolve({})


def test_find_knows_members_of_blocks():
    assert TABLE.find('obstacles.box_1.radius').name == 'obstacles.<name>.radius'
    assert TABLE.find('goal.position').name == 'goal.position'
    for key in ('obstacles.radius', 'obstacles.a.b.radius', 'obstacles.a.', 'goal', ''):
        assert TABLE.find(key) is None


def test_changes_while_running_are_one_new_set():
    start = TABLE.resolve({**OBSTACLE, 'obstacles.names': ['a']})
    before = dict(start)
    added = {'obstacles.names': ['b'], 'obstacles.b.center': [0, 1], 'obstacles.b.radius': 1}
    after = TABLE.reconfigure(start, added)
    assert after['obstacles.b.center'] == [0.0, 1.0]
    assert 'obstacles.a.center' not in after
    assert start == before


def test_a_change_that_needs_a_restart_is_refused():
    start = TABLE.resolve({})
    assert TABLE.reconfigure(start, {'frame_id': 'odom', 'safety.margin': 0.1}) == {
        **start, 'safety.margin': 0.1,
    }  # fmt: skip
    with pytest.raises(ParameterError) as caught:
        TABLE.reconfigure(start, {'frame_id': 'map'})
    assert str(caught.value) == "frame_id: found 'map', wanted 'odom' until a restart"


def test_a_change_that_spoils_the_set_is_refused():
    start = TABLE.resolve({**OBSTACLE, 'obstacles.names': ['a']})
    for changes in ({'obstacles.a.radius': -1}, {'obstacles.names': 3}, {'nonsense': 1}):
        with pytest.raises(ParameterError):
            TABLE.reconfigure(start, changes)


KEYS = [row.key('a') for row in TABLE] + [row.name for row in TABLE] + ['obstacles.b.radius']
SCALARS = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    | st.sampled_from(['a', 'b', 'road', 'exact', 0.5, 1, 10**400, b'x', 1j, object(), {}, set()])
)  # fmt: skip
JUNK = (
    SCALARS | st.lists(SCALARS, max_size=3) | st.lists(st.sampled_from('ab'), max_size=2)
    | st.lists(st.floats(), max_size=3).map(np.array) | st.tuples(st.floats(), st.integers())
)  # fmt: skip


@given(st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=9) | st.integers(), JUNK))
@example({'obstacles.names': ['a'], **OBSTACLE})
@example({'goal.position': np.array([[1.0], [2.0]])})
def test_any_junk_gives_a_valid_set_or_a_parameter_error(values):
    try:
        resolved = TABLE.resolve(values)
    except ParameterError as error:
        refused = error
    else:
        assert TABLE.resolve(resolved) == resolved
        return
    assert len(str(refused).splitlines()) == len(refused.problems) > 0


@given(st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=9), JUNK))
def test_any_junk_as_a_change_leaves_a_valid_set_or_says_why(changes):
    start = TABLE.resolve({**OBSTACLE, 'obstacles.names': ['a']})
    try:
        resolved = TABLE.reconfigure(start, changes)
    except ParameterError:
        return
    assert TABLE.resolve(resolved) == resolved
