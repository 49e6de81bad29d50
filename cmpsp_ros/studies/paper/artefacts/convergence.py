"""Fig. 5: convergence from five guesses without constraints, and Theorem 2."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from cmpsp_ros.studies.paper.artefacts import conditions
from cmpsp_ros.studies.paper.artefacts.conditions import Conditions
from cmpsp_ros.studies.paper.artefacts.fixed_point import Convergence, converge
from cmpsp_ros.studies.paper.claims import Artefact, Claim, Table, Verdict
from cmpsp_ros.studies.paper.drives import Laboratory, guessed_path
from cmpsp_ros.studies.paper.experiments import FIG5_GUESSES, cases, table1
from cmpsp_ros.studies.paper.pictures import key_above
from cmpsp_ros.studies.plot_style import WIDTH

_SECTION = 'Sec. 5, Algorithm Convergence'
_ITERATIONS = 100
_LONG = 300
_TAIL = (50, 100, 200)


def fig5(lab: Laboratory) -> Artefact:
    """Convergence with q = 0 from five guesses, and beside it with q = 15."""
    case1, _, case3 = cases()
    guesses = [guess for guess, _ in FIG5_GUESSES]
    lab.progress('iterating to convergence from five guesses')
    law = [converge(case1, guess, _ITERATIONS, road_center=0.0) for guess in guesses]
    full = [
        converge(case1, guess, _ITERATIONS, road_center=0.0, full_steps=True) for guess in guesses
    ]
    weight = case1.settings.weights.road_center
    lab.progress(f'iterating with q = {weight:g}')
    road = [converge(case1, guess, _LONG, road_center=weight) for guess in guesses]
    lab.progress('measuring the conditions of Theorem 2')
    measured = {
        each.key: conditions.measure(lab.drive(each, between_samples=False).path)
        for each in (case1, case3)
    }
    crude = table1()[1]
    measured['table1_2, first guess'] = conditions.measure(guessed_path(crude))
    claims = [*_rates(law, full, road), _crude_guesses(law), *_theorem(*measured.values())]
    return Artefact(
        'Convergence without constraints: q = 0 and, beside it, q = 15',
        {
            'q_0': [_numbers(*each) for each in zip(guesses, law, full, strict=True)],
            'q_15': [
                {'guess_rad_s': guess, 'changes_rad_s': each.changes.tolist()}
                for guess, each in zip(guesses, road, strict=True)
            ],
            'conditions': {key: vars(each) for key, each in measured.items()},
        },
        claims,
        _draw(law, road),
        [_table(law, full, road)],
    )


def _rates(law: list[Convergence], full: list[Convergence], road: list[Convergence]) -> list[Claim]:
    worst = max(float(each.ratios.max()) for each in law)
    last = max(float(each.ratios[-1]) for each in law)
    arrived = sum(each.converged for each in full)
    tails = [_ratio(road[-1], at) for at in _TAIL]
    return [
        Claim(
            f'{_SECTION}, Fig. 5; (60)',
            '"each of it shows exponential convergence as expected"',
            f'q = 0: all five converge; the ratio of (60) never exceeds {worst:.3f} and ends below'
            f' {last:.0e}. With the full step of (43), {arrived} of 5',
            Verdict.DEPENDS if arrived < len(full) else Verdict.HOLDS,
            'On trust region and line search, which the paper does not have: with them r < 1 for'
            ' each guess. Near the solution it is faster than linear, since with q = 0 the'
            ' multipliers vanish there and the iteration is a Newton iteration.',
        ),
        Claim(
            'Theorem 2 with (95), q = 15',
            '"ensuring Q-linear convergence, i.e. exponential convergence of control history with'
            ' number of iterations"',
            'ratio of successive changes '
            + ', '.join(f'{r:.4f} at {at}' for r, at in zip(tails, _TAIL, strict=True))
            + ' iterations',
            Verdict.of(tails[-1] < tails[0]),
            'The ratio creeps towards 1: slower than any exponential. Without control cost there'
            ' are directions in which the first term of (95) is all but flat, and wheel speeds'
            ' drift. Two iterations a step do not notice.',
        ),
        Claim(
            '(95)',
            'the second term keeps that "the updated control history does not drift away from the'
            ' existing value"',
            f'with q = 15 the change at iteration {_LONG} is still'
            f' {road[-1].changes[-1]:.3f} rad/s, in the direction of the one before (cosine'
            f' {road[-1].drift:.4f})',
            Verdict.DEPENDS,
            'It weighs the change from one iteration to the next and vanishes at a fixed point: it'
            ' slows a drift (a proximal term) and does not prevent it (not a control cost).',
        ),
    ]


def _crude_guesses(law: list[Convergence]) -> Claim:
    order = np.argsort([each.first_miss for each in law])
    counts = [len(law[index].errors) for index in order]
    misses = [law[index].first_miss for index in order]
    return Claim(
        f'{_SECTION}, Fig. 5',
        '"a crude initial guess (with higher ||ΔY_N||) may take a couple of more iterations"',
        'iterations to 1e-8 rad/s by |ΔY_N| of the guess: '
        + ', '.join(f'{n} ({m:.2f} m)' for n, m in zip(counts, misses, strict=True)),
        Verdict.DEPENDS if counts[-1] > counts[0] else Verdict.FAILS,
        'More, yes. A couple more for guesses that miss by about a metre; dozens for the two'
        ' crudest, which the trust region and the line search hold back.',
    )


def _theorem(case1: Conditions, case3: Conditions, guess: Conditions) -> list[Claim]:
    lowest = min(each.least_eigenvalue for each in (case1, case3, guess))
    return [
        Claim(
            f'{_SECTION}; Theorem 2 (i)',
            '"it is obvious that the functions J, Y_N, and g satisfy Condition (i)"',
            'r_k in (95) is a square root, without a derivative at the centre of the road; second'
            ' derivatives of Y_N grow with U',
            Verdict.DEPENDS,
            'On the set of U: Lipschitz continuous on bounded wheel speeds that stay on the road,'
            ' not on all of ℜ^q. By inspection, not measured.',
        ),
        Claim(
            f'{_SECTION}; Theorem 2 (ii)',
            '"Since ∇²J = R_k, R_k has been chosen to be positive definite to ensure that'
            ' Condition (ii) holds"',
            f'least eigenvalue of ∇²J, R included: {case1.least_eigenvalue:.3f} on the path driven'
            f' in Case 1, {case3.least_eigenvalue:.3f} in Case 3,'
            f' {guess.least_eigenvalue:.0f} at guess (45, 45) of Table 1',
            Verdict.of(lowest > 0.0),
            '∇²J is not R: the first term depends on U through the states, and inside the centre'
            ' line it curves downwards along the road. Near the middle of the road R makes up for'
            ' that; "for all values of U" is refuted by a guess of the paper. Gauss-Newton with R'
            ' is positive definite everywhere, and is what is used.',
        ),
        Claim(
            'Lemma 1, (80)',
            '"it can be deduced that (45) is equivalent to" the second-order expansion with'
            ' ∇²J(U^i)',
            f'(45) leaves out {case1.neglected:.1%} of the Hessian of the first term in Case 1,'
            f' {case3.neglected:.1%} in Case 3, {guess.neglected:.0%} at guess (45, 45), in norm',
            Verdict.of(max(case1.neglected, case3.neglected, guess.neglected) < 0.01),
            'The second derivatives of the states by U are missing from (45): states are linearised'
            ' first and the cost is expanded after.',
        ),
        Claim(
            f'{_SECTION}; Theorem 2 (iii)',
            '"none of the inequality constraints in (94) holds with equality … A is an empty set"',
            f'Case 1: {case1.path_rows} of (92), no (94) imposed; Case 3: {case3.wheel_rows} of'
            f' (94) and {case3.path_rows} of (92) (93) active along the path driven',
            Verdict.DEPENDS,
            'True of Case 1. In Case 3 it is not, and the paper says so itself: "the left wheel'
            ' gets into saturation two times". Obstacles are active as well.',
        ),
        Claim(
            f'{_SECTION}; Theorem 2 (iii)(b)',
            '"it is observed that its rank 2 (i.e., full row rank)"',
            f'rank of S_N {case1.rank_S_N} (Case 1), {case3.rank_S_N} (Case 3); rank of G with the'
            f' active rows {case3.rank_G} of {case3.columns_G} (Case 3)',
            Verdict.of(
                case1.rank_S_N == 2 and case3.rank_S_N == 2 and case3.rank_G == case3.columns_G
            ),
            'Full rank also with the active constraints.',
        ),
        Claim(
            f'{_SECTION}; Theorem 2 (iii)(c)',
            'G ∈ ℜ^{2×2}; "since rank{G(U*)} = 2, there exists no vector y such that G(U*)ᵀy = 0"',
            f'S_N is 2 by {case1.size}: {case1.size - case1.rank_G} independent vectors y exist in'
            f' Case 1, {case3.size - case3.rank_G} in Case 3',
            Verdict.FAILS,
            'Rank 2 leaves no y only if there were two unknowns. Condition (iii)(c) is not empty'
            ' and has to be shown; with q = 0 it holds, since ∇²L is then R at the solution.',
        ),
        Claim(
            'After Theorem 2, (90)',
            '"requires at most log(ε/γ)/log r iterations"',
            'neither ε, γ nor r is given for any example',
            Verdict.UNDECIDABLE,
            'No number to compare with.',
        ),
    ]


def _ratio(run: Convergence, at: int) -> float:
    return float(run.changes[at] / run.changes[at - 1])


def _numbers(guess: tuple[float, float], law: Convergence, full: Convergence) -> dict[str, object]:
    return {
        'guess_rad_s': guess,
        'first_miss_m': law.first_miss,
        'errors_rad_s': law.errors.tolist(),
        'ratios': law.ratios.tolist(),
        'full_steps_converge': full.converged,
        'full_steps_last_miss_m': full.last_miss,
    }


def _table(law: list[Convergence], full: list[Convergence], road: list[Convergence]) -> Table:
    rows = [
        (
            f'({guess[0]:g}, {guess[1]:g})',
            f'{one.first_miss:.3f}',
            str(len(one.errors)),
            f'{one.ratios.max():.3f}',
            f'{one.ratios[-1]:.1e}',
            'converges' if two.converged else f'does not: miss {two.last_miss:.1e} m',
            f'{_ratio(three, _TAIL[0]):.4f} / {_ratio(three, _TAIL[-1]):.4f}',
        )
        for (guess, _), one, two, three in zip(FIG5_GUESSES, law, full, road, strict=True)
    ]
    columns = (
        'guess [rad/s]',
        'ΔY_N of the guess [m]',
        'iterations to 1e-8 rad/s, q = 0',
        'largest ratio (60)',
        'last ratio',
        'full steps (43)',
        f'q = 15: ratio of changes at {_TAIL[0]} / {_TAIL[-1]}',
    )
    return Table('Convergence from five guesses', columns, rows)


def _draw(law: list[Convergence], road: list[Convergence]) -> Figure:
    figure = Figure(figsize=(WIDTH, 0.46 * WIDTH), layout='constrained')
    grid = figure.add_gridspec(2, 2, height_ratios=(0.1, 1.0))
    left, right = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    for ((guess, color), one), other in zip(zip(FIG5_GUESSES, law, strict=True), road, strict=True):
        label = f'({guess[0]:g}, {guess[1]:g}) rad/s'
        iterations = np.arange(len(one.errors))
        left.semilogy(iterations, one.errors, 'o-', ms=2.5, color=color, label=label)
        right.loglog(np.arange(1, len(other.changes) + 1), other.changes, color=color)
    left.set(
        xlabel='iteration i',
        ylabel='|U$^i$ − U*| [rad/s]',
        title='(a) q = 0: distance from the solution',
    )
    right.set(
        xlabel='iteration i',
        ylabel='|U$^{i}$ − U$^{i-1}$| [rad/s]',
        title='(b) q = 15: change in one iteration',
    )
    for axes in (left, right):
        axes.grid(visible=True)
    handles, _ = left.get_legend_handles_labels()
    key_above(figure.add_subplot(grid[0, :]), handles, 5)
    return figure
