"""Sixteen problems from five guesses, beside IPOPT; writes doc/method/examples.md and pictures.

``python -m examples`` for all, ``python -m examples cart_pole`` for some, which writes no page.
"""

import argparse
import importlib
import time
from pathlib import Path

import numpy as np

from cmpsp_ros.mpsp import Status, from_casadi, solve
from examples.common import IMAGES, Example, ipopt
from examples.further import EXAMPLES

NAMES = (
    'impact_angle', 'lunar_landing', 'orbit_transfer', 'reentry', 'goddard_rocket', 'cart_pole',
    'two_link_arm', 'quadrotor', 'van_der_pol', 'parking',
)  # fmt: skip
PAGE = Path(__file__).parents[1] / 'doc' / 'method' / 'examples.md'
GUESSES, SPREAD = 5, 0.05
HEAD = """# Examples

Written by `python -m examples`: ten problems of the field, each a file of about a page in
`examples/`, and six more in `examples/further.py`, from five guesses (the file's own, and four with
noise of 5 % of the control's range) by `solve` and by IPOPT on the same CasADi model from the same
start. *Other units* says how `solve` ends where each state and control has a unit of its own, from
0.01 to 100: *same* is the same ending after as many steps. *Same* says that IPOPT, started at our
solution, moves the cost by less than 1e-5 of it. Times are processor times of one run on a busy
machine: compare, do not quote. Compiling, once for each problem, is not in them.

"""
COLUMNS = (
    'Problem', 'Source', 'Guess', 'Ending', 'Steps', 'Other units', 'Cost', 'Same', 'ms', 'IPOPT',
    'Steps', 'Cost', 'ms',
)  # fmt: skip


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


def rows(example: Example) -> tuple[list[str], list[float]]:
    """Lines of the table for one example, and IPOPT's time over ours of each."""
    problem, lines, ratios = from_casadi(**example.stated), [], []
    other_units = from_casadi(**example.in_other_units(example.guess)[0])
    solve(problem, example.guess)
    for number, guess in enumerate(guesses(example)):
        began = time.process_time()
        ours = solve(problem, guess)
        ms = 1e3 * (time.process_time() - began)
        again = solve(other_units, example.in_other_units(guess)[1])
        ends = [f'{each.status.name} {each.iterate.index}' for each in (ours, again)]
        other = ipopt(example.stated, guess, problem.predict(guess))
        at, same = ours.iterate, '-'
        if ours.status is Status.CONVERGED:
            there = ipopt(example.stated, at.U, at.X, stays=True)
            change = abs(there.cost - at.evaluation.cost)
            same = 'yes' if change <= 1e-5 * abs(at.evaluation.cost) else f'**{change:.1e}**'
        ratios.append(1e3 * other.seconds / ms)
        cells = (
            example.name, example.source, number, ours.status.name, at.index,
            'same' if ends[0] == ends[1] else ends[1], f'{at.evaluation.cost:.6g}', same,
            f'{ms:.0f}', other.status, other.iterations, f'{other.cost:.6g}',
            f'{1e3 * other.seconds:.0f}',
        )  # fmt: skip
        lines.append(f'| {" | ".join(map(str, cells))} |')
        print(lines[-1], flush=True)  # noqa: T201 (a program's output)
    return lines, ratios


def main() -> None:
    """Solve, and write the page where all examples are asked for."""
    found = [importlib.import_module(f'examples.{name}').EXAMPLE for name in NAMES] + EXAMPLES
    known = [each.name for each in found]
    parser = argparse.ArgumentParser(prog='python -m examples', description=main.__doc__)
    parser.add_argument('names', nargs='*', metavar='NAME', help=', '.join(known))
    asked = parser.parse_args().names
    if unknown := [name for name in asked if name not in known]:
        parser.error(f'found {", ".join(unknown)}, wanted names of {", ".join(known)}')
    lines, ratios = [], []
    for example in found:
        if not asked or example.name in asked:
            more = rows(example)
            lines += more[0]
            ratios.append(float(np.median(more[1])))
            example.show()
    kept = sum(f'| {Status.CONVERGED.name} |' in line and '| yes |' in line for line in lines)
    summary = (
        f'{kept} of {len(lines)} runs converged at a point that IPOPT keeps. At the median of the\n'
        f'problems `solve` takes {1.0 / np.median(ratios):.2f} times as long as IPOPT with CasADi.'
    )
    print(summary)  # noqa: T201 (a program's output)
    if not asked:
        head = f'| {" | ".join(COLUMNS)} |\n|{"---|" * len(COLUMNS)}\n'
        pictures = [f'![{name}](../images/{IMAGES.name}/{name}.png)' for name in NAMES]
        text = f'{HEAD}{summary}\n\n{head}' + '\n'.join([*lines, '', '\n\n'.join(pictures)])
        PAGE.write_text(text + '\n', 'utf-8')


if __name__ == '__main__':
    main()
