"""A back end's answers held against the references and against the optimality conditions."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.verify.case import Case, Contestant, Origin, Program
from benchmarks.verify.references import (
    ROUNDING,
    Accuracy,
    Reference,
    ReferenceVerdict,
    accuracy,
    contradict,
    cost,
    last_bit,
    nearly_feasible,
    nearly_infeasible,
    references,
    verdict,
)
from cmpsp_ros.mpsp.qp import QPSolution, QPStatus

RESIDUAL = 1e-8  # largest violation of the optimality conditions of an answer that is right

GAP = 1e-7  # largest duality gap of an answer that is right

# Largest difference of the objective from a reference's, relative to the size of its terms.
DIFFERENCE = 1e-7

_WARM_DIFFERENCE = 1e-6
# Part of a residual that must come from the last bit of the controls to call it rounding.
_MOSTLY = 0.3


class Finding(NamedTuple):
    """An unexpected result."""

    # Check made: ``status``, ``residual``, ``gap``, ``objective``, ``conflict`` (the rows named as
    # contradicting) or ``warm start``.
    check: str
    found: str  # finding, in a sentence
    explanation: str  # reason why the back end is not at fault; '' if it is


@dataclass(frozen=True)
class Comparison:
    """Result of one case."""

    origin: Origin  # name of the case
    about: str  # description
    verdict: ReferenceVerdict  # verdict of the references
    status: QPStatus  # status of the back end, cold
    accuracy: Accuracy  # accuracy of its answer; ``inf`` if it claims no solution
    # Relative difference of the objective from that of the best reference; 0 unless there are two
    # to compare.
    difference: float
    # Iterations of the back end, cold and with a warm start (0 if there is none).
    iterations: tuple[int, int]
    findings: tuple[Finding, ...]  # unexpected results

    @property
    def is_mismatch(self) -> bool:
        """True if there is an unexplained finding."""
        return any(not finding.explanation for finding in self.findings)


def compare(case: Case, contestant: Contestant) -> Comparison:
    """Solve a case in every way and compare the answers.

    An error of the back end passes through, with the name of the case added.
    """
    try:
        return _compare(case, contestant)
    except Exception as error:
        error.add_note(f'{contestant.name} at {case.origin}: {case.about}')
        raise


def _compare(case: Case, contestant: Contestant) -> Comparison:
    program = case.program
    answers = references(program)
    cold = contestant.cold(program)
    measured, difference = accuracy(program, cold), 0.0
    findings = _status_findings(program, cold, answers)
    if cold.status is QPStatus.SOLVED:
        findings += _accuracy_findings(program, cold, measured, answers)
        if math.isfinite(answers[0].accuracy.gap):
            difference = _difference(program, cold, answers[0].solution)
            findings += _objective_findings(difference, measured, answers[0])
    elif cold.conflict and not contradict(program, cold.conflict):
        findings.append(Finding('conflict', f'{len(cold.conflict)} rows that go together', ''))
    warm_iterations = 0
    if contestant.warm is not None:
        warm = contestant.warm(program, case.before)
        warm_iterations = warm.iterations
        findings += _warm_findings(program, (cold, measured), warm)
    return Comparison(
        case.origin,
        case.about,
        verdict(answers),
        cold.status,
        measured,
        difference,
        (cold.iterations, warm_iterations),
        tuple(findings),
    )


def _status_findings(
    program: Program, answer: QPSolution, answers: list[Reference]
) -> list[Finding]:
    expected, status = verdict(answers), answer.status
    if (expected, status) in {
        (ReferenceVerdict.SOLVED, QPStatus.SOLVED),
        (ReferenceVerdict.INFEASIBLE, QPStatus.INFEASIBLE),
    }:
        return []
    found = f'{status.name}; {", ".join(_says(each) for each in answers)}'
    explanation = ''
    if expected is ReferenceVerdict.UNKNOWN and status is not QPStatus.FAILED:
        # A solution shows itself by its residual; the denial of one must be made good.
        proved = status is QPStatus.SOLVED or not nearly_feasible(program)
        explanation = 'no reference can tell, and this can' if proved else ''
    elif expected is ReferenceVerdict.UNKNOWN:
        explanation = 'no reference can tell either'
    elif expected is ReferenceVerdict.INFEASIBLE and nearly_feasible(program):
        explanation = f'less than {ROUNDING:g} is missing to feasibility'
    elif expected is ReferenceVerdict.SOLVED and status is QPStatus.FAILED:
        # Degenerate programs are all on the border, and are to be solved nevertheless.
        explanation = ''
    elif expected is not ReferenceVerdict.INFEASIBLE and nearly_infeasible(program):
        explanation = f'limits tighter by {ROUNDING:g} leave no solution'
    elif expected is ReferenceVerdict.DISPUTED:
        explanation = _settled(program, status)
    return [Finding('status', found, explanation)]


def _settled(program: Program, status: QPStatus) -> str:
    """Reason why the back end is right although references disagree, '' if it is not."""
    exists = nearly_feasible(program)
    right = status is (QPStatus.SOLVED if exists else QPStatus.INFEASIBLE)
    return 'references contradict each other, and the least violation agrees' if right else ''


def _says(reference: Reference) -> str:
    words = f'{reference.name} {reference.solution.status.name}'
    if math.isfinite(reference.accuracy.residual):
        words += f' with residual {reference.accuracy.residual:.1e}'
    return words


def _accuracy_findings(
    program: Program, answer: QPSolution, measured: Accuracy, answers: list[Reference]
) -> list[Finding]:
    findings = []
    for check, found, limit in zip(Accuracy._fields, measured, (RESIDUAL, GAP), strict=True):
        if abs(found) <= limit:
            continue
        best = min(abs(getattr(each.accuracy, check)) for each in answers)
        # Where no reference is right there is nothing that they could excuse.
        excused = abs(found) < best < math.inf
        explanation = f'no reference comes nearer than {best:.1e}' if excused else ''
        if check == 'residual' and not explanation:
            explanation = _rounding(program, answer, found)
        findings.append(Finding(check, f'{found:.1e}, wanted within {limit:g}', explanation))
    return findings


def _rounding(program: Program, answer: QPSolution, residual: float) -> str:
    """Explanation of a residual by rounding alone."""
    change = last_bit(program, answer) if math.isfinite(residual) else 0.0
    if change < _MOSTLY * residual:
        return ''
    return f'the last bit of the controls changes it by {change:.1e}'


def _difference(program: Program, answer: QPSolution, reference: QPSolution) -> float:
    """Objective of an answer above that of a reference, relative to the size of its terms."""
    ours, theirs = cost(program, answer.dU), cost(program, reference.dU)
    return (ours.value - theirs.value) / theirs.size


def _objective_findings(difference: float, measured: Accuracy, best: Reference) -> list[Finding]:
    if abs(difference) <= DIFFERENCE:
        return []
    explanation = ''
    if measured.residual <= RESIDUAL and abs(measured.gap) <= GAP:
        explanation = (
            f'the gap here is {measured.gap:.1e}, that of {best.name} {best.accuracy.gap:.1e}'
        )
    found = f'{difference:+.1e} relative to that of {best.name}, wanted within {DIFFERENCE:g}'
    return [Finding('objective', found, explanation)]


def _warm_findings(
    program: Program, without: tuple[QPSolution, Accuracy], warm: QPSolution
) -> list[Finding]:
    cold, measured = without
    if warm.status is not cold.status:
        found = f'{warm.status.name} with a warm start, {cold.status.name} cold'
        on_border = nearly_feasible(program) and nearly_infeasible(program)
        explanation = f'limits that differ by {ROUNDING:g} decide' if on_border else ''
        return [Finding('warm start', found, explanation)]
    if cold.status is not QPStatus.SOLVED:
        return []
    warmed = accuracy(program, warm)
    if warmed.residual > max(RESIDUAL, measured.residual):
        explanation = _rounding(program, warm, warmed.residual)
        return [Finding('warm start', f'residual {warmed.residual:.1e} with it', explanation)]
    change = float(np.abs(warm.dU - cold.dU).max()) / (1.0 + float(np.abs(cold.dU).max()))
    if change <= _WARM_DIFFERENCE:
        return []
    explanation = ''
    if max(abs(warmed.gap), abs(measured.gap)) <= GAP:
        explanation = f'a flat minimum: the gaps are {warmed.gap:.1e} and {measured.gap:.1e}'
    return [Finding('warm start', f'controls differ by {change:.1e}', explanation)]
