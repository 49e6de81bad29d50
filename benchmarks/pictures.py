"""Results as pictures: over horizons, of steps and the longest, of the way over DDS."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from benchmarks.results import Results
from cmpsp_ros.studies import WIDTH

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency


_BINS = 60
_HEIGHT = 3.6
_COLORS = (
    '#1a1a1a', '#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#8c564b',
    '#9467bd', '#7f7f7f', '#bcbd22', '#e377c2',
)  # fmt: skip
_MARKERS = 'osD^vP*X<>ph'


def pictures(results: Results) -> dict[str, Figure]:
    """All pictures, by name."""
    drawn = {'horizons': _horizons(results), 'steps': _steps(results), 'tails': _tails(results)}
    if results.latency is not None:
        drawn['latency'] = _latency(results.latency)
    return drawn


def _horizons(results: Results) -> Figure:
    figure = Figure(figsize=(WIDTH, _HEIGHT + 0.6), layout='constrained')
    axes = figure.add_subplot()
    for each, color, marker in zip(results.growth, cycle(_COLORS), cycle(_MARKERS), strict=False):
        exponent = '' if each.exponent is None else f'  ($N^{{{each.exponent:.2f}}}$)'
        axes.loglog(each.steps, each.times, marker=marker, ms=4, color=color,
                    label=f'{each.name}{exponent}')  # fmt: skip
    axes.set(xlabel='steps $N$ of the horizon', ylabel='first step [µs]')
    axes.set_xticks(results.order.horizons, [str(each) for each in results.order.horizons])
    axes.minorticks_off()
    axes.grid()
    figure.legend(loc='outside right upper')
    return figure


def _steps(results: Results) -> Figure:
    """One row a method, for histograms on top of one another hide one another."""
    timed = results.comparison.timed
    figure = Figure(figsize=(WIDTH, 0.6 + 0.55 * len(timed)), layout='constrained')
    every = np.concatenate([each.times.ravel() for each in timed])
    bins = np.geomspace(every.min() / 1.05, every.max() * 1.05, _BINS + 1)
    rows = figure.subplots(len(timed), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each, color in zip(rows, timed, cycle(_COLORS), strict=False):
        axes.hist(each.times.ravel(), bins=bins, color=color, alpha=0.8)
        axes.axvline(float(np.median(each.times)), color='0.35', lw=0.8)
        axes.set_ylabel(each.name, rotation=0, ha='right', va='center')
        axes.set_yticks([])
        axes.set_xscale('log')
    rows[-1].set_xlabel('step of the closed loop [µs]; the line is the median')
    return figure


def _tails(results: Results) -> Figure:
    figure = Figure(figsize=(WIDTH, _HEIGHT), layout='constrained')
    axes = figure.add_subplot()
    # The baseline, which has no tail, keeps the first colour.
    for each, color in zip(results.tails, cycle(_COLORS[1:]), strict=False):
        longest_first = np.sort(each.times)[::-1]
        share = np.arange(1, len(longest_first) + 1) / len(longest_first)
        axes.loglog(longest_first, share, color=color, drawstyle='steps-pre', label=each.name)
        axes.axvline(float(np.median(each.times)), color=color, lw=0.8, ls=':')
    axes.set(xlabel='step of the closed loop [µs]; the dotted line is the median',
             ylabel='share of steps that take as long')  # fmt: skip
    axes.grid()
    if results.tails:
        axes.legend()
    return figure


def _latency(found: Latency) -> Figure:
    figure = Figure(figsize=(WIDTH, _HEIGHT), layout='constrained')
    times, jitter = figure.subplots(1, 2)
    for sample, name, color in (
        (found.total, 'odometry to command', _COLORS[1]),
        (found.own, 'of that the node itself', _COLORS[2]),
    ):
        bins = np.linspace(0.0, float(found.total.max()) * 1.02, _BINS + 1)
        times.hist(sample, bins=bins, alpha=0.7, color=color, label=name)
    times.set(xlabel='latency [ms]', ylabel='control steps')
    times.legend()
    jitter.hist(found.jitter, bins=_BINS, color=_COLORS[3], alpha=0.8)
    jitter.set(xlabel='jitter: change from one control step to the next [ms]')
    return figure
