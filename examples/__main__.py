"""Every example from five guesses, beside IPOPT; writes doc/method/examples.md and pictures.

``python -m examples`` for all, ``python -m examples cart_pole`` for some, which writes no page.
"""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path

import numpy as np

from cmpsp_ros.mpsp import Status, from_casadi, solve
from examples.common import IMAGES, Example, ipopt

NAMES = (
    'impact_angle', 'lunar_landing', 'orbit_transfer', 'reentry', 'goddard_rocket', 'cart_pole',
    'two_link_arm', 'quadrotor', 'van_der_pol', 'parking',
)  # fmt: skip
PAGE = Path(__file__).parents[1] / 'doc' / 'method' / 'examples.md'
GUESSES, SPREAD = 5, 0.05
HEAD = """# Examples

Written by `python -m examples`: problems of the field, each a file of about a page in `examples/`,
from five guesses (the file's own, and four with noise of 5 % of the control's range) by `solve` and
by IPOPT on the same CasADi model from the same start. *Same* says that IPOPT, started at our
solution, moves the cost by less than 1e-5 of it. Times are of one run on a busy machine: compare,
do not quote.

| Problem | Source | Guess | Ending | Steps | Cost | Same | ms | IPOPT | Steps | Cost | ms |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def guesses(example: Example) -> list[np.ndarray]:
    """The example's own guess, and seeded ones about it."""
    rng, first = np.random.default_rng(0), example.guess
    bounds = [np.asarray(example.stated.get(name, 0.0), float) for name in ('lower', 'upper')]
    width = np.zeros(first.shape[1])
    width[: example.stated['u'].shape[0]] = np.where(
        bounds[1] > bounds[0], bounds[1] - bounds[0], 1.0
    )
    noise = [SPREAD * width * rng.uniform(-1.0, 1.0, first.shape) for _ in range(GUESSES - 1)]
    return [first, *(first + each for each in noise)]


def rows(example: Example) -> list[str]:
    """Lines of the table for one example."""
    problem, found = from_casadi(**example.stated), []
    solve(problem, example.guess, max_iterations=2)
    for number, guess in enumerate(guesses(example)):
        began = time.perf_counter()
        ours = solve(problem, guess)
        ms = 1e3 * (time.perf_counter() - began)
        other = ipopt(example.stated, guess, problem.predict(guess))
        at, same = ours.iterate, '-'
        if ours.status is Status.CONVERGED:
            again = ipopt(example.stated, at.U, at.X, stays=True)
            change = abs(again.cost - at.evaluation.cost)
            same = 'yes' if change <= 1e-5 * abs(at.evaluation.cost) else f'**{change:.1e}**'
        found.append(
            f'| {example.name} | {example.source} | {number} | {ours.status.name} | {at.index} | '
            f'{at.evaluation.cost:.6g} | {same} | {ms:.0f} | {other.status} | {other.iterations} | '
            f'{other.cost:.6g} | {1e3 * other.seconds:.0f} |'
        )
        print(found[-1], flush=True)  # noqa: T201 (a program's output)
    return found


def main() -> None:
    """Solve, and write the page where all examples are asked for."""
    names = sys.argv[1:] or NAMES
    lines = []
    for name in names:
        example = importlib.import_module(f'examples.{name}').EXAMPLE
        lines += rows(example)
        example.show()
    if not sys.argv[1:]:
        pictures = [f'![{name}](../images/{IMAGES.name}/{name}.png)' for name in NAMES]
        PAGE.write_text(HEAD + '\n'.join(lines) + '\n\n' + '\n\n'.join(pictures) + '\n', 'utf-8')


if __name__ == '__main__':
    main()
