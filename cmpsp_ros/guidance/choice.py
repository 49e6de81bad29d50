"""The choice of a plan: the one under way, those kept alive beside it, and new ones if need be.

A warm start can be a trap, such as a plan that ends before an obstacle because it once aimed at its
middle, or one on the side where no time is left. So where plans can differ in more than detail,
one for each of the most promising ways is kept and improved beside the one that is followed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.audit import Audit, Verdict
from cmpsp_ros.guidance.candidate import Candidate, Start
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon, shift, to_nanoseconds
from cmpsp_ros.guidance.initial_guess import along_road, initial_guess
from cmpsp_ros.guidance.merit_of_plan import Judge, Merit
from cmpsp_ros.guidance.planner import Planner
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.guidance.task import Task
from cmpsp_ros.guidance.ways_through import (
    MOST_WAYS,
    Signature,
    in_words,
    signature_of,
    ways_through,
)

Array = NDArray[np.float64]

CANDIDATES: Final = 4
"""How many plans are compared at a control step, at most."""

_MILLISECONDS = 1e-6

# Times a plan is improved before it is judged when there was none before, as long as it has a flaw.
_ROUNDS_AT_REST = 3
# Control steps for which a plan beside the one followed may have a flaw.
_PATIENCE = 5
# New plans are made every control step if the one followed may not be, else ever more seldom.
_LONGEST_PAUSE = 7


@dataclass(frozen=True)
class _Contender:
    """A plan with what it was improved by.

    Attributes:
        planner: Its own planner, which knows its active constraints.
        candidate: The plan, improved and audited.
        merit: How good it is.
        signature: Which way it takes.
        strikes: For how many control steps in a row it has had a flaw.
    """

    planner: Planner
    candidate: Candidate
    merit: Merit
    signature: Signature
    strikes: int = 0


@dataclass(frozen=True)
class _Moment:
    """What all plans of one control step have in common."""

    start: Start
    held: Array
    horizon: Horizon


class Choice:
    """Improves plans and says which to follow."""

    def __init__(
        self,
        settings: GuidanceSettings,
        audit: Audit,
        timer: Callable[[], int],
        candidates: int = CANDIDATES,
    ) -> None:
        """Take the settings, with nothing known yet.

        Args:
            settings: All settings of the guidance law.
            audit: What every plan must pass.
            timer: Monotonic time [ns].
            candidates: How many plans to compare at most; with 1, only the one along the centre
                line is tried, where the one followed needs slack or fails its audit.

        Raises:
            ValueError: The number of candidates is not from 1 to `MOST_WAYS`.
        """
        if not 1 <= candidates <= MOST_WAYS:
            raise ValueError(f'candidates: found {candidates}, wanted 1 to {MOST_WAYS}')
        self._settings, self._audit, self._timer = settings, audit, timer
        self._most = candidates
        self._planner = Planner(settings)
        self._spare = [Planner(settings)]
        self._task, self._judge = Task(settings), Judge(settings)
        self._delay = to_nanoseconds(settings.command_delay)
        self._names = [obstacle.name for obstacle in settings.obstacles]
        self._centers = np.array([each.center for each in settings.obstacles]).reshape(-1, 2)
        self._beside: list[_Contender] = []
        self.phases: dict[str, float] = {}
        self.forget()

    def forget(self) -> None:
        """Begin again: all ways are looked at afresh at the next control step."""
        self._spare += [each.planner for each in self._beside]
        self._beside = []
        self._review = True
        self._pause = self._waited = 0
        self._remark = ''

    @property
    def remark(self) -> str:
        """Which way was chosen last, and from how many, in a sentence; empty without a choice."""
        return self._remark

    def best(self, start: Start, held: Array, plan: Plan | None, horizon: Horizon) -> Candidate:
        """Improve the plan, and others where that may help, and choose.

        Args:
            start: Where plans begin.
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
            plan: The one followed until now, if any.
            horizon: Horizon of the plans wanted.
        """
        self.phases, self._remark = dict.fromkeys(('solve', 'audit'), 0.0), ''
        moment = _Moment(start, held, horizon)
        if plan is None:
            self._planner.forget()
            guess = initial_guess(self._settings, start.pose, horizon.durations)
        else:
            guess = shift(plan.controls, plan.horizon, horizon)
        warm = self._improved(self._planner, guess, moment)
        if self._most == 1:
            return self._or_fresh(warm, moment)
        review = self._is_wanted(warm)
        if not review and not self._beside:
            return warm
        return self._chosen(warm, moment, review=review, at_rest=plan is None)

    def _is_wanted(self, warm: Candidate) -> bool:
        """Whether to look for new plans; seldom, where that has not helped for a while."""
        if not self._judge.is_flawed(warm):
            self._pause = self._waited = 0
            return self._review
        self._waited += 1
        return self._review or not warm.usable or self._waited > self._pause

    def _or_fresh(self, warm: Candidate, moment: _Moment) -> Candidate:
        """The plan along the centre line, if the warm one has a flaw that it has not."""
        if warm.flawless:
            return warm
        planner = self._free_planner()
        guess = along_road(self._settings, moment.start.pose, moment.horizon.durations)
        fresh = self._improved(planner, guess, moment)
        if not fresh.beats(warm):
            self._spare.append(planner)
            return warm
        self._spare.append(self._planner)
        self._planner = planner
        return fresh

    def _chosen(
        self, warm: Candidate, moment: _Moment, *, review: bool, at_rest: bool
    ) -> Candidate:
        followed = self._contender(self._planner, warm, moment)
        if at_rest and review:
            followed = self._settled(followed, moment)
        contenders = [self._continued(each, moment) for each in self._beside]
        # Room for a fresh plan, whatever is known already.
        room = self._most - 2 if review else self._most - 1
        contenders = self._worth_while(contenders, room)
        if review:
            self._review = False
            contenders += list(self._new(followed, contenders, moment, at_rest=at_rest))
        count = 1 + len(contenders)
        best = followed
        for each in contenders:
            best = each if each.merit.beats(best.merit) else best
        self._keep(best, [followed, *contenders])
        if review:
            self._waited = 0
            self._pause = 0 if best is not followed else min(2 * self._pause + 1, _LONGEST_PAUSE)
        self._remark = self._said(best, count, changed=best is not followed)
        return best.candidate

    def _said(self, best: _Contender, count: int, *, changed: bool) -> str:
        if count == 1:
            return ''
        words = in_words(best.signature, self._names)
        way = f', {words}' if words else ''
        verb = 'Changed over to' if changed else 'It is'
        return f' {verb} the best of {count} plans{way}.'

    def _worth_while(self, contenders: list[_Contender], room: int) -> list[_Contender]:
        """Those that have not had a flaw for too long; of too many, those without first."""
        ordered = sorted(contenders, key=lambda each: each.strikes)
        kept = [each for each in ordered[:room] if each.strikes <= _PATIENCE]
        self._spare += [each.planner for each in ordered[len(kept) :]]
        return kept

    def _new(
        self,
        followed: _Contender,
        beside: list[_Contender],
        moment: _Moment,
        *,
        at_rest: bool,
    ) -> Iterator[_Contender]:
        """Plans from scratch: along the centre line, and by ways that no plan takes yet."""
        sound = {each.signature for each in (followed, *beside) if not each.merit.flawed}
        pose, durations = moment.start.pose, moment.horizon.durations
        road = along_road(self._settings, pose, durations)
        guesses, most = [road], self._most - 1 - len(beside)
        if at_rest and self._settings.initial_guess.type == 'road':
            # The one followed was made from it just now.
            guesses = []
        if self._names and most > len(guesses):
            began = self._timer()
            space = self._task.space(road, durations)
            ways = ways_through(self._settings, space, pose, durations, most - len(guesses), sound)
            guesses += [way.guess for way in ways]
            self.phases['solve'] += (self._timer() - began) * _MILLISECONDS
        for guess in guesses[:most]:
            planner = self._free_planner()
            contender = self._contender(planner, self._improved(planner, guess, moment), moment)
            yield self._settled(contender, moment) if at_rest else contender

    def _keep(self, best: _Contender, contenders: list[_Contender]) -> None:
        """Go on with one plan, and with the best of every other way."""
        kept = {best.signature: best}
        for each in contenders:
            rival = kept.get(each.signature)
            if rival is None or (rival is not best and each.merit.beats(rival.merit)):
                kept[each.signature] = each
        self._planner = best.planner
        self._beside = [each for each in kept.values() if each is not best]
        going_on = {id(each) for each in kept.values()}
        self._spare += [each.planner for each in contenders if id(each) not in going_on]

    def _continued(self, contender: _Contender, moment: _Moment) -> _Contender:
        plan = contender.candidate.plan
        guess = shift(plan.controls, plan.horizon, moment.horizon)
        candidate = self._improved(contender.planner, guess, moment)
        found = self._contender(contender.planner, candidate, moment)
        return replace(found, strikes=contender.strikes + 1 if found.merit.flawed else 0)

    def _settled(self, contender: _Contender, moment: _Moment) -> _Contender:
        """Improved further, as long as it has a flaw."""
        for _ in range(_ROUNDS_AT_REST - 1):
            if not contender.merit.flawed or not contender.candidate.improvement.solved:
                break
            controls = contender.candidate.plan.controls
            candidate = self._improved(contender.planner, controls, moment)
            contender = self._contender(contender.planner, candidate, moment)
        return contender

    def _contender(self, planner: Planner, candidate: Candidate, moment: _Moment) -> _Contender:
        began = self._timer()
        signature = signature_of(
            self._settings.road, self._centers, candidate.plan.poses, self._settings.goal
        )
        merit = self._judge.merit(candidate, moment.held)
        self.phases['audit'] += (self._timer() - began) * _MILLISECONDS
        return _Contender(planner, candidate, merit, signature)

    def _improved(self, planner: Planner, guess: Array, moment: _Moment) -> Candidate:
        began = self._timer()
        improvement = planner.improve(moment.start.pose, moment.held, guess, moment.horizon)
        solved = self._timer()
        verdict = self.judge(moment.start, improvement.plan.controls, moment.horizon)
        self.phases['solve'] += (solved - began) * _MILLISECONDS
        self.phases['audit'] += (self._timer() - solved) * _MILLISECONDS
        if self._delay:
            improvement = replace(improvement, plan=replace(improvement.plan, delay=self._delay))
        return Candidate(improvement, verdict)

    def judge(self, start: Start, controls: Array, horizon: Horizon) -> Verdict:
        """The verdict on a plan and on the way to its beginning."""
        verdict = self._audit.check(start.pose, controls, horizon.durations)
        return verdict if start.way is None else start.way.followed_by(verdict)

    def _free_planner(self) -> Planner:
        """A planner that knows nothing of another plan."""
        planner = self._spare.pop() if self._spare else Planner(self._settings)
        planner.forget()
        return planner
