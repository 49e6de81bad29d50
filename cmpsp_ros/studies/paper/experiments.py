"""The paper's runs: preset, initial guess, heading and colour of each."""

import math
from dataclasses import dataclass, replace
from typing import Final

from cmpsp_ros.guidance import GuidanceSettings, InitialGuess
from cmpsp_ros.parameters import TABLE, config_directory, guidance_settings, load_parameter_file

# Right and left wheel [rad/s], colour: Sec. 5, "Algorithm Convergence"; the colours are ours.
FIG5_GUESSES: Final = (
    ((30.0, 29.5), 'red'),
    ((35.0, 34.5), 'green'),
    ((40.0, 39.5), 'magenta'),
    ((43.0, 42.5), 'blue'),
    ((45.0, 44.5), 'black'),
)

# Right and left wheel [rad/s], colour.
TABLE1_GUESSES: Final = (
    ((45.0, 44.5), 'black'),
    ((45.0, 45.0), 'blue'),
    ((18.0, 15.0), 'magenta'),
    ((44.5, 44.5), 'green'),
)

# Initial heading [deg], colour; from (0, -9.25) m, with `TABLE2_GUESS`.
TABLE2_HEADINGS: Final = ((60.0, 'black'), (0.0, 'blue'), (-60.0, 'green'))
TABLE2_GUESS: Final = (36.0, 36.0)  # right and left wheel [rad/s]
_CASE3: Final = ('case3', 'Case 3', 'red')


@dataclass(frozen=True)
class Experiment:
    """One run of the paper."""

    key: str  # unique among all runs
    label: str  # for legends and tables
    color: str  # the paper's, if it names one
    settings: GuidanceSettings
    pose: tuple[float, float, float]  # where it begins [m, m, rad]

    def with_bound(self, between_samples: bool) -> GuidanceSettings:
        """Settings that keep the path clear between samples too, or the samples only."""
        safety = replace(self.settings.safety, between_samples=between_samples)
        return replace(self.settings, safety=safety)


def cases() -> tuple[Experiment, ...]:
    """Cases 1 to 3, the last with the 51 rad/s of (94)."""
    first = _preset('case1', 'Case 1', 'black'), _preset('case2', 'Case 2', 'blue')
    return (*first, _preset(*_CASE3))


def case3_at_45() -> Experiment:
    """Case 3 with the 45 rad/s of the text."""
    return _preset('case3_45', 'Case 3, 45 rad/s', 'magenta')


def table1() -> tuple[Experiment, ...]:
    """Case 3 from the four guesses of Table 1."""
    return tuple(
        _case3(f'table1_{row}', f'guess ({guess[0]:g}, {guess[1]:g})', color, guess)
        for row, (guess, color) in enumerate(TABLE1_GUESSES, 1)
    )


def road_guess() -> Experiment:
    """Case 3 from a guess along the road's centre line."""
    return _case3('road_guess', 'road guess', '', None)


def table2(*, as_printed: bool = False) -> tuple[Experiment, ...]:
    """Case 3 from the three headings of Table 2."""
    y, suffix = (9.25, '_as_printed') if as_printed else (-9.25, '')
    return tuple(
        replace(
            _case3(
                f'table2_{row}{suffix}',
                f'heading {heading:g}°'.replace('-', '−'),
                color,
                TABLE2_GUESS,
            ),
            pose=(0.0, y, math.radians(heading)),
        )
        for row, (heading, color) in enumerate(TABLE2_HEADINGS, 1)
    )


def few_obstacles() -> tuple[Experiment, ...]:
    """Zero, one and two obstacles, sparsely placed."""
    return tuple(map(_obstacle_file, ('zero', 'one', 'two'), ('black', 'red', 'green')))


def many_obstacles() -> tuple[Experiment, ...]:
    """Three, four and five obstacles, densely packed."""
    return tuple(map(_obstacle_file, ('three', 'four', 'five'), ('blue', 'magenta', 'cyan')))


def _case3(key: str, label: str, color: str, guess: tuple[float, float] | None) -> Experiment:
    case3 = _preset(*_CASE3)
    initial = InitialGuess('road') if guess is None else InitialGuess('constant', guess)
    settings = replace(case3.settings, initial_guess=initial)
    return replace(case3, key=key, label=label, color=color, settings=settings)


def _preset(name: str, label: str, color: str) -> Experiment:
    return _experiment(name, label, color, load_parameter_file(name))


def _obstacle_file(count: str, color: str) -> Experiment:
    label = f'{count} obstacle' if count == 'one' else f'{count} obstacles'
    key = label.replace(' ', '_')
    given = load_parameter_file(config_directory() / 'paper' / f'{key}.yaml')
    names = ', '.join(given.get('obstacles.names', ()))
    return _experiment(key, f'{label} ({names})' if names else label, color, given)


def _experiment(key: str, label: str, color: str, given: dict[str, object]) -> Experiment:
    values = TABLE.resolve(given)
    x, y, heading = values['initial_pose']
    return Experiment(key, label, color, guidance_settings(values), (x, y, heading))
