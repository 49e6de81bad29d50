"""Picture of a what-if: commands over time and plans on the road, of both laws."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.replay.what_if import WhatIf
from cmpsp_ros.robots import with_side
from cmpsp_ros.view import BAGS, GOAL, course, draw, show, traces

_PLANS = 4
_ROOM = 0.5

_RECORDED, _CHANGED = BAGS[:2]


def draw_what_if(result: WhatIf, title: str, path: Path) -> None:
    """Draw it."""
    figure = Figure(figsize=(13.0, 6.5), layout='constrained')
    figure.suptitle(f'{title}\nOpen loop: the robot followed the recorded commands only.')
    grid = figure.add_gridspec(2, 2)
    above = figure.add_subplot(grid[0, 0])
    below = figure.add_subplot(grid[1, 0], sharex=above)
    _draw_commands((above, below), result)
    _draw_plans(figure.add_subplot(grid[:, 1]), result)
    figure.savefig(path, dpi=120)


def _draw_commands(axes: Sequence[Axes], result: WhatIf) -> None:
    commanded = [each for each in result.recorded if each.command is not None]
    begin = result.recorded[0].stamp
    before = np.array([each.stamp - begin for each in commanded]) / 1e9
    changed = np.array([each.stamp - begin for _, each in result.decisions]) / 1e9
    recorded_twists = np.array([each.command for each in commanded]).reshape(-1, 3)
    decided = [with_side(each.twist) for _, each in result.decisions]
    twists = np.array(decided).reshape(-1, 3)
    for one, index, name in zip(axes, (0, 2), ('speed [m/s]', 'turn rate [rad/s]'), strict=True):
        one.step(before, recorded_twists[:, index], where='post', color=_RECORDED, label='recorded')
        one.step(changed, twists[:, index], where='post', color=_CHANGED, ls='--', label='changed')
        one.set_ylabel(name)
        one.grid(alpha=0.3)
    axes[0].legend()
    axes[-1].set_xlabel('time since the first decision [s]')


def _draw_plans(axes: Axes, result: WhatIf) -> None:
    draw(axes, traces(course([result.settings.road], result.settings.obstacles), ''))
    driven = np.array([each.pose[:2] for each in result.odometry]).reshape(-1, 2)
    recorded = [np.array(each.path)[:, :2] for each in result.recorded if each.path]
    changed = [each.plan.poses[:, :2] for _, each in result.decisions if each.plan is not None]
    for plans, color, style, name in (
        (recorded, _RECORDED, '-', 'recorded plans'),
        (changed, _CHANGED, '--', 'changed plans'),
    ):
        for index, plan in enumerate(_some(plans)):
            label = name if index == 0 else None
            axes.plot(*plan.T, style, color=color, lw=1.2, label=label, zorder=4)
    axes.plot(*driven.T, color='black', lw=2.0, label='driven, as recorded', zorder=3)
    axes.plot(*result.settings.goal, '*', color=GOAL, ms=14, label='goal', zorder=5)
    show(axes, [driven, np.array([result.settings.goal]), *recorded, *changed], _ROOM)
    axes.legend(loc='best')


def _some(plans: Sequence[Array]) -> list[Array]:
    """A few of the plans, from the first on."""
    return [plans[part * len(plans) // _PLANS] for part in range(_PLANS)] if plans else []
