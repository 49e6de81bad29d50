"""Parameter files of every kind: refused in words, or a law whose commands are safe."""

import re
from collections import Counter
from pathlib import Path

import hypothesis
import numpy as np
from hypothesis import HealthCheck, Phase, given
from hypothesis import strategies as st

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file

PRESETS = [
    (Path(__file__).parents[3] / 'config' / f'{name}.yaml').read_text(encoding='utf-8')
    for name in ('case1', 'case2', 'case3', 'case3_45')
]
NUMBER = re.compile(r'(?<=[:\[,] )-?\d+\.\d+|(?<=\[)-?\d+\.\d+')
STEPS = 4
LONGEST = 500
"""Control steps of a horizon beyond which a set is accepted and not driven, to save time."""

numbers = (
    st.floats().map(repr)
    | st.floats(0.0, 100.0).map(repr)
    | st.integers(-3, 100).map(str)
    | st.sampled_from(['1e300', '-1e300', '1e-300', '.inf', '-.inf', '.nan', '1e7', '1e-7', '0.0'])
)
scalars = numbers | st.sampled_from(
    [
        *('true', 'false', 'null', '', "''", 'annulus', 'daqp', 'hildreth', 'exact', 'constant'),
        *('x: y', '[]', '[a, b]', '[a, a]', '{a: b}', '&a [*a]', '!!python/object:os.system {}'),
        *('- 1', '[1.0'),
    ]
)
pairs = st.tuples(numbers, numbers).map(lambda pair: f'[{pair[0]}, {pair[1]}]')
plausible = st.floats(0.01, 20.0).map(repr)
values = st.one_of(plausible, plausible, numbers, pairs, scalars)
damages = st.lists(
    st.tuples(
        st.sampled_from(['value', 'value', 'value', 'drop', 'repeat', 'insert']),
        st.integers(0, 200),
        values,
    ),
    min_size=0,
    max_size=2,
)


def damaged(text, damage):
    """A file with a few lines changed."""
    lines = text.splitlines()
    places = [number for number, line in enumerate(lines) if ':' in line.partition('#')[0]]
    for kind, number, value in damage:
        place = places[number % len(places)] % max(len(lines), 1)
        if kind == 'value':
            lines[place] = f'{lines[place].partition(":")[0]}: {value}'
        elif kind == 'drop':
            del lines[place]
        elif kind == 'repeat':
            lines.insert(place, lines[place])
        else:
            lines.insert(place, f'    {value}')
    return '\n'.join(lines) + '\n'


def changed(text, factors, signs):
    """A file with some of its numbers multiplied, so that most of it is still as it should be."""
    remaining = [*zip(factors, signs, strict=False)]

    def change(found):
        if not remaining:
            return found[0]
        factor, change_this = remaining.pop()
        return repr(float(found[0]) * factor) if change_this else found[0]

    return NUMBER.sub(change, text)


factors = st.one_of(
    st.floats(0.3, 3.0),
    st.integers(-12, 12).map(lambda power: 10.0**power),
    st.sampled_from([0.0, -1.0, 1e-300, 1e300]),
)
files = st.one_of(
    *[st.builds(damaged, st.sampled_from(PRESETS), damages)] * 4,
    *[
        st.builds(
            changed,
            st.sampled_from(PRESETS),
            st.lists(factors, min_size=30, max_size=30),
            st.lists(st.sampled_from([False] * 9 + [True]), min_size=30, max_size=30),
        )
    ]
    * 5,
    st.text(max_size=200),
    st.binary(max_size=200).map(lambda raw: raw.decode('latin-1')),
)


def read(path):
    """The settings that a file gives to guidance."""
    return guidance_settings(TABLE.resolve(load_parameter_file(path)))


def drive(given_):
    """A few steps from the road's centre line; what was decided, each found safe."""
    road, robot = given_.road, given_.robot
    pose = np.array([road.center[0], road.center[1] - road.center_radius, 0.0])
    law, decided = GuidanceLaw(given_, given_.world), []
    period = round(given_.control_period * 1e9)
    for step in range(STEPS):
        decision = law.step(Observation(step * period, pose))
        decided.append(decision.level.name.lower())
        assert decision.reason[-1] in '.?', decision.reason
        assert np.isfinite([*decision.wheel_speeds, *decision.twist]).all(), decision
        assert np.abs(decision.wheel_speeds).max() <= robot.max_wheel_speed
        if decision.level is FallbackLevel.STOP:
            assert not decision.wheel_speeds.any()
        duration = np.array([given_.control_period])
        pose = robot.roll_out(pose, decision.wheel_speeds[None], duration)[-1]
    return decided


def fuzz(count, seed, folder):
    """Try so many files; returns what became of them."""
    outcomes, path = Counter(), folder / 'parameters.yaml'

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        # What fails is told as it was found: to make it smaller takes minutes.
        phases=[Phase.generate],
    )
    @given(files)
    def attempt(text):
        path.write_text(text, encoding='utf-8', errors='surrogatepass')
        outcomes['files'] += 1
        try:
            settings = read(path)
        except ParameterError:
            outcomes['refused'] += 1
            return
        outcomes['accepted'] += 1
        if settings.final_time <= LONGEST * settings.control_period:
            outcomes.update(drive(settings))

    attempt()
    return dict(outcomes)
