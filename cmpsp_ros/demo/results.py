"""Figures and pictures from the bag of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cmpsp_ros.bags.runs import read_run
from cmpsp_ros.demo.pictures import draw_controls, draw_trajectory
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.demo.summary import Summary, final_time, summarise


def sum_up(scenario: Scenario, folder: Path) -> Summary:
    """Write `summary.json` and the pictures of a run beside its bag.

    Returns:
        Its figures.

    Raises:
        BagError: The recording does not cover the run.
    """
    recorded = read_run(folder / 'bag')
    settings = replace(scenario.settings, final_time=final_time(recorded, scenario.settings))
    scenario = replace(scenario, settings=settings)
    summary = summarise(recorded, scenario.truth, scenario.name)
    summary.write(folder / 'summary.json')
    draw_trajectory(recorded, scenario.settings, folder / 'trajectory.png', scenario.hidden)
    draw_controls(recorded, scenario.settings, folder / 'wheel_speeds.png')
    return summary
