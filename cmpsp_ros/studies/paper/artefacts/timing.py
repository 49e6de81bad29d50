"""Computing time of a control step, compared with the paper's."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.studies.paper.claims import Artefact, Claim, Table, Verdict
from cmpsp_ros.studies.paper.drives import Laboratory, run_law
from cmpsp_ros.studies.paper.experiments import cases
from cmpsp_ros.studies.processor import cpu_model

_PAPER_MS = 150.0
_RUNS = 5


def timing(lab: Laboratory) -> Artefact:
    """Median and longest control step of Cases 1 to 3 on this machine."""
    names = [each.label for each in cases()]
    for each in cases():
        lab.drive(each, between_samples=True)
    lab.progress('timing control steps')
    rounds = [[run_law(each, between_samples=True).step_times for each in cases()]
              for _ in range(_RUNS)]  # fmt: skip
    steps = [np.concatenate(of_case) for of_case in zip(*rounds, strict=True)]
    median, longest = float(np.median(steps[2])), float(steps[2].max())
    cpu = cpu_model()
    rows = [
        (name, f'{np.median(each):.2f}', f'{each.max():.2f}', f'{_PAPER_MS / np.median(each):.0f}')
        for name, each in zip(names, steps, strict=True)
    ]
    table = Table(
        f'Computing time of a control step, {_RUNS} runs each, on {cpu}',
        ('run', 'median [ms]', 'longest [ms]', 'paper / median'),
        rows,
    )
    claims = [
        Claim(
            'Sec. 5, Computational Efficiency',
            '"with a Δt = 0.2s the run-time of the algorithm is about 0.15s" (i3-3220, Matlab)',
            f'Case 3: median {median:.2f} ms, longest {longest:.2f} ms a control step on {cpu};'
            f' {_PAPER_MS / median:.0f} times faster at the median',
            Verdict.UNDECIDABLE,
            'Another machine and language; and the paper does not say whether 0.15 s is for a'
            ' control step, an iteration or the first step. As 0.15 < 0.2 it is taken for a step.',
        ),
        Claim(
            'Sec. 5, Computational Efficiency',
            '"With a dedicated processor and code written in a low-level language … the'
            ' computational time is expected to be significantly lower"',
            f'{_PAPER_MS / median:.0f} times lower with compiled kernels under Python',
            Verdict.of(median < _PAPER_MS / 2.0),
            'On a general-purpose processor, ten years younger.',
        ),
    ]
    numbers = {
        'cpu': cpu,
        'paper_ms': _PAPER_MS,
        'runs': _RUNS,
        'median_ms': {n: float(np.median(each)) for n, each in zip(names, steps, strict=True)},
        'longest_ms': {n: float(each.max()) for n, each in zip(names, steps, strict=True)},
    }
    return Artefact('Computing time', numbers, claims, tables=[table])
