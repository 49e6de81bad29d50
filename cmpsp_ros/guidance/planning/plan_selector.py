"""The choice of a plan: the one under way, those kept alive beside it, and new ones if need be.

A warm start can be a trap, such as a plan that ends before an obstacle because it once aimed at its
middle, or one on the side where no time is left. So where plans can differ in more than detail,
one for each of the most promising ways is kept and improved beside the one that is followed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon, shift, to_nanoseconds
from cmpsp_ros.guidance.planning.alternatives import Guesses, standing
from cmpsp_ros.guidance.planning.candidate import Candidate, Start
from cmpsp_ros.guidance.planning.homotopy.gaps import Signature
from cmpsp_ros.guidance.planning.homotopy.homotopy_class import in_words, signature_of
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import Moment
from cmpsp_ros.guidance.planning.ranking import Judge, Merit
from cmpsp_ros.guidance.safety.audit import Audit, Verdict
from cmpsp_ros.guidance.settings import SCREENING, GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.roads.road import Annulus

Array = NDArray[np.float64]

_MILLISECONDS = 1e-6

# Control steps for which a plan beside the one followed may have a flaw, or cost more than it.
_PATIENCE = 5
# New plans are made every control step if the one followed may not be, else ever more seldom.
_LONGEST_PAUSE = 7
# How much more work a step may do while the robot stands and waits for its first plan, and on the
# plan that it follows.
_PATIENT = 4
# Control steps for which a plan that may be followed is given the time to mend a flaw. A robot that
# is not quite as modelled puts a little of one into every plan, and each change of plans is a jerk.
_TRANSIENT = 4


class _Contender(NamedTuple):
    """A plan with what it was improved by.

    Attributes:
        planner: Its own planner, which knows its active constraints.
        candidate: The plan, improved and audited.
        merit: How good it is.
        signature: Which way it takes.
        strikes: For how many control steps in a row it has had a flaw, or cost more than the plan
            followed.
    """

    planner: Planner
    candidate: Candidate
    merit: Merit
    signature: Signature
    strikes: int = 0


class Choice:
    """Improves plans and says which to follow."""

    def __init__(self, settings: GuidanceSettings, audit: Audit, timer: Callable[[], int]) -> None:
        """Take the settings, with nothing known yet.

        Args:
            settings: All settings of the guidance law.
            audit: What every plan must pass.
            timer: Monotonic time [ns].
        """
        self._settings, self._audit, self._timer = settings, audit, timer
        # Only between two circles ways are known, and told apart.
        known = isinstance(settings.road, Annulus) and settings.follow is None
        self._most = settings.solver.candidates if known else 1
        self._planner = Planner(settings)
        self._spare = [Planner(settings) for _ in range(max(1, self._most - 1))]
        self._guesses, self._judge = Guesses(settings, self._most), Judge(settings)
        self._delay = to_nanoseconds(settings.command_delay)
        self._names = [obstacle.name for obstacle in settings.obstacles]
        self._centers = FreeSpace.of(settings.road, settings.obstacles, 0.0).centers
        self._beside: list[_Contender] = []
        self.phases: dict[str, float] = {}
        self._work_left = 1
        self.forget()

    def aim(self, settings: GuidanceSettings) -> None:
        """Take another goal; nothing else of the settings may differ."""
        if settings is self._settings:
            return
        self._settings = settings
        self._judge.aim(settings)
        for planner in (self._planner, *self._spare, *(each.planner for each in self._beside)):
            planner.aim(settings)

    def forget(self) -> None:
        """Begin again: all ways are looked at afresh at the next control step."""
        self._spare += [each.planner for each in self._beside]
        self._beside = []
        self._review = True
        self._pause = self._waited = self._troubled = 0
        self._remark = ''

    def look_again(self) -> None:
        """Look at all ways at the next control step: something new is in sight."""
        self._review = True

    @property
    def remark(self) -> str:
        """Which way was chosen last, and from how many, in a sentence; empty without a choice."""
        if self._work_left > 0:
            return self._remark
        return f'{self._remark} The work of this step was used up.'

    def best(self, start: Start, held: Array, plan: Plan | None, horizon: Horizon) -> Candidate:
        """Improve the plan, and others where that may help, and choose.

        Args:
            start: Where plans begin.
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
            plan: The one followed until now, if any.
            horizon: Horizon of the plans wanted.
        """
        self.phases, self._remark = dict.fromkeys(('solve', 'audit'), 0.0), ''
        # The plan that is followed comes first; others have what it leaves.
        self._work_left = self._settings.solver.work_limit(self._settings.control_period)
        if plan is None:
            self._work_left *= _PATIENT
        moment = Moment(start, held, horizon, plan, self._settings)
        if plan is None:
            self._planner.forget()
            guess, *others = self._guessed(self._guesses.first, moment)
        else:
            guess, others = shift(plan.controls, plan.horizon, horizon), None
        warm = self._improved(self._planner, guess, moment, patience=_PATIENT)
        if self._most == 1:
            return self._or_fresh(warm, moment)
        review = others is not None or self._is_wanted(warm)
        if not review and not self._beside:
            return warm
        return self._polished(self._chosen(warm, moment, others, review=review), moment)

    def _guessed(self, make: Callable[..., list[Array]], *arguments: Any) -> list[Array]:
        """Guesses, and the time that they take."""
        began = self._timer()
        guesses = make(*arguments)
        self.phases['solve'] += (self._timer() - began) * _MILLISECONDS
        return guesses

    def _is_wanted(self, warm: Candidate) -> bool:
        """Whether to look for new plans; seldom, where that has not helped for a while."""
        if not self._judge.is_wanting(warm):
            self._pause = self._waited = self._troubled = 0
            return self._review
        self._waited += 1
        self._troubled += 1
        return (
            self._review
            or not warm.usable
            or (self._troubled > _TRANSIENT and self._waited > self._pause)
        )

    def _may_leave(self, warm: Candidate) -> bool:
        """Whether to change over at all from a plan that is under way."""
        return self._review or not warm.usable or self._troubled > _TRANSIENT

    def _or_fresh(self, warm: Candidate, moment: Moment) -> Candidate:
        """Where the plan has a flaw, the one along the centre line if that has none.

        Whatever moves may come too close at first: where the robot stands anyway, a plan from
        standing still is tried as well.
        """
        if warm.flawless or self._work_left <= 0:
            return warm
        start, horizon = moment.start, moment.horizon
        guess = along_road(self._settings, start.pose, horizon.durations, start.near)
        best = self._better(warm, guess, moment)
        if best.usable or not moment.at_rest:
            return best
        return self._better(best, standing(horizon), moment)

    def _better(self, known: Candidate, guess: Array, moment: Moment) -> Candidate:
        """The plan followed, or one from another guess, if that is better."""
        planner = self._free_planner()
        fresh = self._improved(planner, guess, moment)
        if not fresh.beats(known):
            self._spare.append(planner)
            return known
        self._spare.append(self._planner)
        self._planner = planner
        return fresh

    def _chosen(
        self, warm: Candidate, moment: Moment, guesses: list[Array] | None, *, review: bool
    ) -> Candidate:
        followed, may_leave = self._contender(self._planner, warm, moment), self._may_leave(warm)
        # Room for a fresh plan, whatever is known already.
        room = self._most - 2 if review else self._most - 1
        contenders, waiting = [], []
        for each in self._worth_while(self._beside, room):
            if self._work_left > 0:
                contenders.append(self._continued(each, moment))
            else:
                waiting.append(each._replace(strikes=each.strikes + 1))
        if review:
            self._review = False
            contenders += self._fresh([followed, *contenders], moment, guesses)
        count = 1 + len(contenders)
        best = followed
        if may_leave:
            for each in contenders:
                best = each if each.merit.beats(best.merit) else best
        self._troubled = self._troubled if best is followed else 0
        self._keep(best, [followed, *contenders])
        self._beside += waiting
        if review:
            self._waited = 0
            self._pause = 0 if best is not followed else min(2 * self._pause + 1, _LONGEST_PAUSE)
        changed = best is not followed and not moment.at_rest
        self._remark = self._said(best, count, moment, changed=changed)
        return best.candidate

    def _said(self, best: _Contender, count: int, moment: Moment, *, changed: bool) -> str:
        if count == 1:
            return ''
        words = in_words(best.signature, [*self._names, *moment.met.names])
        way = f', {words}' if words else ''
        verb = 'Changed over to' if changed else 'It is'
        return f' {verb} the best of {count} plans{way}.'

    def _worth_while(self, contenders: list[_Contender], room: int) -> list[_Contender]:
        """Those that have not been worse for too long; of too many, the better ones first."""
        ordered = sorted(contenders, key=lambda each: each.strikes)
        kept = [each for each in ordered[:room] if each.strikes <= _PATIENCE]
        self._spare += [each.planner for each in ordered[len(kept) :]]
        return kept

    def _fresh(
        self, known: list[_Contender], moment: Moment, guesses: list[Array] | None
    ) -> list[_Contender]:
        """Plans from scratch, by ways that no sound plan takes yet where no guesses are given."""
        if guesses is None:
            sound = {each.signature for each in known if not each.merit.flawed}
            room = self._most - len(known)
            guesses = self._guessed(self._guesses.fresh, moment, room, sound)[:room]
        fresh = self._new_ones(guesses, moment)
        every = [*known, *fresh]
        if not moment.at_rest or not all(each.merit.flawed for each in every):
            return fresh
        # Whatever moves ahead may need more room than there is: turning where it stands does not.
        turning = self._guessed(self._guesses.turning, moment)
        fresh += self._new_ones(turning, moment)
        if any(each.candidate.usable for each in every):
            return fresh
        # Or it may come too close at first: standing still does not.
        return [*fresh, self._new(standing(moment.horizon), moment)]

    def _new_ones(self, guesses: list[Array], moment: Moment) -> list[_Contender]:
        """New plans, as many as there is work left for."""
        return [self._new(guess, moment) for guess in guesses if self._work_left > 0]

    def _new(self, guess: Array, moment: Moment) -> _Contender:
        planner = self._free_planner()
        return self._contender(planner, self._improved(planner, guess, moment), moment)

    def _keep(self, best: _Contender, contenders: list[_Contender]) -> None:
        """Go on with one plan, and with the best of every other way that may yet be better."""
        kept = {best.signature: best}
        for each in contenders:
            rival = kept.get(each.signature)
            if rival is None or (rival is not best and each.merit.beats(rival.merit)):
                kept[each.signature] = each
        self._planner = best.planner
        self._beside = [
            each._replace(strikes=each.strikes + 1 if each.merit.is_worse_than(best.merit) else 0)
            for each in kept.values()
            if each is not best and not best.merit.outclasses(each.merit)
        ]
        going_on = {id(each.planner) for each in (best, *self._beside)}
        self._spare += [each.planner for each in contenders if id(each.planner) not in going_on]

    def _continued(self, contender: _Contender, moment: Moment) -> _Contender:
        plan = contender.candidate.plan
        guess = shift(plan.controls, plan.horizon, moment.horizon)
        candidate = self._improved(contender.planner, guess, moment)
        return self._contender(contender.planner, candidate, moment, contender.strikes)

    def _contender(
        self, planner: Planner, candidate: Candidate, moment: Moment, strikes: int = 0
    ) -> _Contender:
        began = self._timer()
        centers = np.concatenate([self._centers, moment.met.centers])
        signature = signature_of(
            self._settings.annulus, centers, candidate.plan.poses, self._settings.goal
        )
        merit = self._judge.merit(candidate, moment.held)
        self.phases['audit'] += (self._timer() - began) * _MILLISECONDS
        return _Contender(planner, candidate, merit, signature, strikes)

    def _polished(self, chosen: Candidate, moment: Moment) -> Candidate:
        """The plan chosen, with the iterations that the others need not have."""
        first = chosen.improvement.iterations
        left = self._settings.solver.initial_iterations - first
        if not moment.at_rest or not chosen.flawless or first < SCREENING:
            return chosen
        if left <= 0 or self._work_left <= 0:
            return chosen
        polished = self._improved(self._planner, chosen.plan.controls, moment, left)
        if not polished.flawless:
            return chosen
        count = first + polished.improvement.iterations
        return polished._replace(improvement=polished.improvement._replace(iterations=count))

    def _iterations(self, moment: Moment) -> int | None:
        """How many every plan is given at first; None for as many as at any control step."""
        if not moment.at_rest:
            return None
        initial = self._settings.solver.initial_iterations
        return initial if self._most == 1 else min(initial, SCREENING)

    def _improved(
        self,
        planner: Planner,
        guess: Array,
        moment: Moment,
        iterations: int = 0,
        patience: int = 1,
    ) -> Candidate:
        began = self._timer()
        improvement = planner.improve(
            moment.start.pose,
            moment.held,
            guess,
            moment.horizon,
            iterations=iterations or self._iterations(moment),
            moving=moment.start.moving,
            near=moment.start.near,
            work_limit=max(self._work_left, 0) * patience,
        )
        self._work_left -= improvement.work
        solved = self._timer()
        verdict = self.judge(moment.start, improvement.plan.controls, moment.horizon)
        self.phases['solve'] += (solved - began) * _MILLISECONDS
        self.phases['audit'] += (self._timer() - solved) * _MILLISECONDS
        if self._delay:
            improvement = improvement._replace(plan=improvement.plan._replace(delay=self._delay))
        return Candidate(improvement, verdict)

    def judge(self, start: Start, controls: Array, horizon: Horizon) -> Verdict:
        """The verdict on a plan and on the way to its beginning."""
        verdict = self._audit.check(
            start.pose, controls, horizon.durations, start.moving, start.near
        )
        return verdict if start.way is None else start.way.followed_by(verdict)

    def _free_planner(self) -> Planner:
        """A planner that knows nothing of another plan."""
        planner = self._spare.pop() if self._spare else Planner(self._settings)
        planner.forget()
        return planner
