"""The search for the longest step with which a method reaches an accuracy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol

from ..methods import EIG3, RK8, Method
from ..run.accuracy import RESOLVED
from .pilots import CONVERGING, FEWEST, TELLING, PilotRun, Pilots, PilotStates

NO_TIME = "no time was left to try it"
GUIDE = RK8()
SCOUT = EIG3()  # among methods with one evaluation, it has the longest stable step
_STABLE = {GUIDE: 5.9, SCOUT: 1.5}  # their steps are stable up to about these multiples of the shortest time constant
_AGREEMENT = 0.25  # two runs whose difference is within this fraction of the accuracy give a reference
_AGREEMENT_AT_MOST = 0.05  # runs with a larger relative difference may both be wrong
#: The trials for a reference: the part of the span, the method, and the time limit of its runs, s.
_TRIALS = (
    (1.0, GUIDE, 0.3),
    (1.0, SCOUT, 4.0),
    (1 / 16, GUIDE, 1.0),
    (1 / 16, SCOUT, 2.5),
    (1 / 256, GUIDE, 0.5),
    (1 / 256, SCOUT, 0.5),
    (1 / 4096, GUIDE, 0.5),
)
_SHORTEST_PART = 1 / 16  # from a shorter part, errors are only extrapolated if their growth is known
_GUIDE_WORK = 2**26  # the work that is always allowed for one trial,
_SHORT = 1.0  # if the next run is expected to take less time than this, s
_SHORTER = 0.5  # and less than this if the error of the last run gives no hope
_SLOWER = 2.0  # a run that takes longer by this factor than was expected is stopped
_SURVEY_SECONDS = 5.0  # longest processor time of a run that surveys the whole span,
_UNSTABLE_SECONDS = 1.0  # and of the unstable runs before it
_SLOW_UNSTABLE = 0.1  # the next unstable run would take longer, s: the next run is stable at its beginning
_MOST_RUNS = 24  # runs of a method
_NEAR = 1.06  # the longest step is found to this factor,
_ENOUGH = 0.7  # or until the error is at least this fraction of the aim
_COARSE = 1.1  # between two steps this far apart, the longest step is interpolated
_SAME = 1.04  # steps closer than this need no run
_LARGEST = 2.0  # the relative error of two unrelated motions of the same size
_APART = 1.2  # least ratio of two steps that shows the order of the error
_STEEP = 2.0  # an error that grows with more than this multiple of its order is caused by instability
_ROUND_OFF = 1e-6  # an error below this is round-off if it decreases with a power of the step
_SURELY_ROUND_OFF = 1e-11  # kinks of the force can let a larger error seem to be round-off
_FAR = 100.0  # an error of this multiple of the aim is far from it
_STALLED = 0.5  # below this
_FASTER = 10.0  # an error that is larger by this factor grows faster than with the square of time
_LEAST = 5e-14  # runs agree better than this only by chance


def guide(pilots: Pilots) -> Search | str:
    """Find a reference, and the runs of the method that lead to it, or return the reason why there is none.

    RK8 runs over the whole span. If this takes too long, EIG-3 surveys the whole span at a stable step. If this gives
    no reference either, the runs cover the part of the span with the fastest motion in the survey.
    """
    if pilots.aim < _LEAST:
        return "the accuracy is below round-off"
    failure = ""
    shortest = math.inf  # unstable step over a longer part
    longer: list[tuple[float, PilotRun]] = []  # longer parts, and their runs with the most steps
    survey: Search | None = None
    for part, method, seconds in _TRIALS:
        if method == SCOUT and part < 1 and not survey:
            continue
        if part != pilots.part:
            pilots.look_at(part)
            if survey and survey.runs:
                pilots.calibrate(SCOUT, survey.runs[-1])
        search = Search(pilots, method)
        is_survey = method == SCOUT and part == 1
        found = _double(search, seconds, surveys=is_survey)
        if is_survey:
            survey = search if _is_bounded(search) else None
        if search.runs or not failure:
            failure = search.failure
        if method == GUIDE:
            stable = [run.n_steps for run in search.runs if not math.isinf(run.error)]
            if not survey and stable and shortest < part * pilots.span / stable[0]:
                return search.without_stable_run  # over the longer part
            if search.runs and not stable:
                shortest = part * pilots.span / search.runs[-1].n_steps
        if found:
            result = _beside(longer, search, seconds) if longer and method == GUIDE else search
            is_far = part < _SHORTEST_PART and not pilots.knows_growth
            return search.unknown_growth if is_far and isinstance(result, Search) else result
        if search.is_chaotic:
            return _too_fast(pilots, part, search.runs[-1])
        if search.is_stalled and search.runs[-1].error < _SURELY_ROUND_OFF:
            return search.failure
        if method == GUIDE and search.runs:
            longer.append((part, search.runs[-1]))
    return failure


def _double(search: Search, allowed: float, *, surveys: bool = False) -> bool:
    """Double the steps until the error is known and far below the aim; return whether this is reached.

    The runs take at most `allowed` seconds, unless they are within the work that is always allowed. A survey of the
    whole span continues until a run is bounded; unstable runs end early and take less time.
    """
    pilots, method = search.pilots, search.method
    until, work, n_steps = pilots.spent + allowed, 0.0, FEWEST
    unstable = next_unstable = 0.0
    coarse: PilotStates | None = None
    while _may_run(search, n_steps, until, work) or (
        surveys and not coarse and unstable + next_unstable < min(_UNSTABLE_SECONDS, pilots.left)
    ):
        before = pilots.left
        expected = _SLOWER * max(_SHORTER, pilots.predicted(method, n_steps))
        fine = pilots.history(method, n_steps, _SURVEY_SECONDS if surveys else expected)
        work += pilots.work(method, n_steps)
        if fine is None:
            search.add(PilotRun(n_steps, math.inf))
            pilots.forget_survey()
            unstable += before - pilots.left
            next_unstable = 2 * (before - pilots.left)
            if next_unstable > _SLOW_UNSTABLE:
                n_steps = max(n_steps, pilots.stable_steps(method, _STABLE[method]) // 2)
        else:
            pilots.note_sizes(fine)
            search.is_settled = coarse is None or pilots.have_one_speed(coarse, fine)
            if not fine.is_whole:
                return False
            if not pilots.needs_reference:
                search.add(pilots.judged(n_steps, fine))
            elif coarse:
                pilots.refer_to(fine)
                search.add(pilots.judged(n_steps // 2, coarse))
        wanted = pilots.aim if search.is_stalled else _agreement(pilots)  # round-off prevents a better reference
        if search.runs and search.runs[-1].error <= wanted:
            pilots.trust()
            return True
        if search.is_stalled:
            return False
        coarse = fine
        n_steps *= 2
    if search.reaches:
        pilots.trust()
    return search.reaches


def _beside(longer: Sequence[tuple[float, PilotRun]], search: Search, seconds: float) -> Search | str:
    """Return a search over a short part whose errors grow with time as runs over longer parts show; or why none can.

    With equal steps, the error of a regular motion grows at most with about the square of time.
    """
    pilots = search.pilots
    for part, run in longer:
        coarser = [each.seen_error for each in search.runs if each.n_steps / pilots.part <= run.n_steps / part]
        largest = _FASTER * (part / pilots.part) ** 2 * min(coarser, default=math.inf)
        if largest < run.seen_error < math.inf and run.error > pilots.aim:
            return _too_fast(pilots, part, run)
        pilots.note_growth(search.runs, part, run)
    growth = (1 / pilots.part) ** pilots.least_power
    if all(run.error >= growth * run.seen_error for run in search.runs):  # the errors were extrapolated so far already
        return search
    again = Search(pilots, search.method)
    if _double(again, seconds):
        return again
    return (
        f"the error grows like t^{pilots.least_power:.2g}, and cannot be known from runs over "
        f"{pilots.part * pilots.span:.3g} time units"
    )


def _too_fast(pilots: Pilots, part: float, run: PilotRun) -> str:
    """Return the reason why a run over this part of the span allows no prediction."""
    t = part * pilots.span
    return (
        f"the error grows too fast with time, as in chaos or after kinks of the force: over {t:.3g} time units, it is "
        f"{run.seen_error:.1e} with h = {t / run.n_steps:.2g}"
    )


def _is_bounded(search: Search) -> bool:
    """Whether the runs of a survey have shown a stable motion; otherwise the survey is discarded."""
    pilots = search.pilots
    if not search.is_settled or any(_LARGEST < run.error < math.inf for run in search.runs[-1:]):
        pilots.forget_survey()
    return pilots.is_surveyed


def _agreement(pilots: Pilots) -> float:
    """The largest difference of two runs with which the finer run is a reference."""
    return min(_AGREEMENT * pilots.aim, _AGREEMENT_AT_MOST)


def _may_run(search: Search, n_steps: int, until: float, work: float) -> bool:
    """Whether a run, and the runs that must follow it, are within the allowed work or the time."""
    pilots, method = search.pilots, search.method
    error = search.runs[-1].error if search.runs else math.inf
    following = 1.0
    if error <= CONVERGING:  # the error with a half or a quarter of the steps: more steps reduce it by the order
        following = max(1.0, (error / _agreement(pilots)) ** (1 / method.order) / 2)
    seconds = pilots.predicted(method, n_steps)
    in_time = pilots.spent + seconds * following < until
    # A larger error is caused by instability, and two errors show whether the motion is chaotic.
    is_hopeful = error <= CONVERGING or error > _LARGEST or sum(run.seen_error <= _LARGEST for run in search.runs) < 2
    is_small = work + pilots.work(method, n_steps * following) < _GUIDE_WORK
    # A run over a part of the span takes at least as many steps.
    has_fewest = pilots.part == 1 and n_steps <= 2 * FEWEST and seconds < pilots.left / 3
    is_small &= seconds < (_SHORT if is_hopeful else _SHORTER) or has_fewest
    return seconds < pilots.left and (is_small or (in_time and is_hopeful))


class Timed(Protocol):
    """The results of a search: the evaluations and seconds of a step, the steps, and the run that reaches the aim."""

    evaluations: int

    @property
    def pace(self) -> float: ...

    @property
    def steps(self) -> int: ...

    @property
    def _good(self) -> Any: ...

    @property
    def seconds(self) -> float:
        """The predicted time; infinite if unknown."""
        return self.steps * self.pace if self.steps else math.inf

    @property
    def reaches(self) -> bool:
        """Whether a run has reached the aim."""
        return self._good is not None


class Search(Timed):
    """The search for the longest step with which a method reaches the aim."""

    rtol = None

    def __init__(self, pilots: Pilots, method: Method) -> None:
        self.pilots, self.method, self.evaluations = pilots, method, pilots.evaluations(method)
        self.label = method.label
        self.runs: list[PilotRun] = []  # from the fewest steps to the most
        self.is_settled = True  # whether the last two runs of a search for a reference show a motion of one speed

    def add(self, run: PilotRun) -> None:
        """Add a run. From a part of the span, the errors of all runs are extrapolated by the fastest growth of one."""
        runs = sorted([*self.runs, run], key=lambda run: run.n_steps)
        telling = [each for each in runs if _SURELY_ROUND_OFF < each.seen_error < TELLING]
        if self.pilots.part >= _SHORTEST_PART and telling:
            growth = max(each.error / each.seen_error for each in telling)
            runs = [replace(each, error=max(each.error, growth * each.seen_error)) for each in runs]
        self.runs = runs

    def run(
        self,
        other: Timed,
        *,
        longest: float = math.inf,
        until: float = math.inf,
        work: float = 0.0,
        enough: float = math.inf,
    ) -> None:
        """Run until the longest step is known, or the next run would take too long.

        The first run takes as long as `other` takes to reach the aim. A run takes at most `longest` seconds and ends
        before the pilot runs have taken `until` seconds, unless it is within the remaining `work`. After `enough`
        seconds of pilot runs, a step that reaches the aim is not improved.
        """
        guess = other.pace / other.evaluations * self.evaluations
        n_steps = self._next() if self.runs else other.seconds / guess * self.pilots.part
        while n_steps and len(self.runs) < _MOST_RUNS:
            pace = self.pace if math.isfinite(self.pace) else guess
            allowed = min(longest, until - self.pilots.spent)
            most = max(allowed / pace * self.pilots.part, work / self.pilots.work(self.method, 1))
            n_steps = self.pilots.possible(min(n_steps, most))
            if n_steps * pace > self.pilots.left or (self.reaches and self.pilots.spent > enough):
                return
            tried = any(run.n_steps <= n_steps < _SAME * run.n_steps for run in self.runs)
            if tried or (self.runs and n_steps > _NEAR * most):
                return
            self.add(self.pilots.run(self.method, n_steps))
            work -= self.pilots.work(self.method, n_steps)
            n_steps = self._next()

    def time_a_step(self) -> float:
        """Seconds of a step, measured in a short run."""
        return self.pilots.time_of_a_step(self.method, self.steps, self.pace)

    @property
    def pace(self) -> float:
        """Seconds of a step, in the fastest run; infinite if no run was stable."""
        return min((run.seconds for run in self.runs if math.isfinite(run.seconds)), default=math.inf)

    @property
    def _bad(self) -> PilotRun | None:
        """The run with the most steps that does not reach the aim."""
        return next((run for run in reversed(self.runs) if not run.error <= self.pilots.aim), None)

    @property
    def _good(self) -> PilotRun | None:
        """The run with the fewest steps such that it and all finer runs reach the aim."""
        bad = self._bad
        return next((run for run in self.runs if not bad or run.n_steps > bad.n_steps), None)

    def _next(self) -> float | None:
        """The steps of the next run, before they are rounded; None if no run is needed."""
        good, bad, aim = self._good, self._bad, self.pilots.aim
        if not good:
            last = self.runs[-1]
            if self.is_stalled:
                return None
            factor = min(4.0, 1.05 * (last.error / aim) ** (1 / self.order)) if last.error < CONVERGING else 1.5
            return max(factor, _NEAR) * last.n_steps
        if not bad:
            factor = max(1 / 4, 0.97 * (good.error / aim) ** (1 / self.order))
            return min(factor, 1 / _NEAR) * good.n_steps
        ratio = good.n_steps / bad.n_steps
        if ratio < _NEAR or good.error > _ENOUGH * aim:
            return None
        between = self._between(bad, good) if bad.error < CONVERGING else math.sqrt(ratio) * bad.n_steps
        return max(between, 1.001 * _SAME * bad.n_steps)

    def _between(self, bad: PilotRun, good: PilotRun) -> float:
        """The steps for an error just below the aim, if the error is a power of the step."""
        return 1.01 * bad.n_steps * (bad.error / self.pilots.aim) ** (1 / self._slope(bad, good))

    def _slope(self, bad: PilotRun, good: PilotRun) -> float:
        return math.log(bad.error / max(good.error, 1e-300)) / math.log(good.n_steps / bad.n_steps)

    @property
    def order(self) -> float:
        """The order of convergence over the two runs with the most steps, or otherwise the order of the method."""
        known = float(self.method.order)
        return min(2 * known, max(known / 2, self.observed)) if self.observed else known

    @property
    def observed(self) -> float | None:
        converging = [run for run in self.runs if run.error < CONVERGING][-2:]
        return self._slope(*converging) if len(converging) == 2 else None

    @property
    def follows_order(self) -> bool:
        """Whether the error decreases with the step as the order predicts, and can be extrapolated."""
        return self.observed is not None and not self.is_limited and not self.is_stalled

    @property
    def is_far_off(self) -> bool:
        """Whether the run with the most steps is stable, and its error is far too large to converge to the aim."""
        return bool(self.runs) and max(CONVERGING, _FAR * self.pilots.aim) < self.runs[-1].error < _LARGEST

    @property
    def is_limited(self) -> bool:
        """Whether stability limits the step: with a longer step, the error grows much faster than by the order."""
        if not self._bad:
            return False
        fine = self._good or self.runs[-1]
        coarse = next((run for run in reversed(self.runs) if _APART * run.n_steps < fine.n_steps), None)
        if coarse is None:
            return self._bad.error > _LARGEST
        return coarse.error > _LARGEST or self._slope(coarse, fine) > _STEEP * (self.method.order + 1)

    @property
    def is_stalled(self) -> bool:
        """Whether round-off prevents a decrease of the error."""
        before = self.runs[-2].error if len(self.runs) > 1 else math.inf
        return before < _ROUND_OFF and (self.observed or 0.0) < _STALLED

    @property
    def steps(self) -> int:
        """The steps over the whole span that reach the aim; 0 if unknown."""
        steps, part = self._steps, self.pilots.part
        if steps and part < 1:
            return math.ceil(max(steps / part, self._fewest))
        return math.ceil(steps / part)

    @cached_property
    def _fewest(self) -> float:
        """The least number of steps over the whole span for events that the runs do not contain."""
        return self.pilots.fewest(self.method)

    @property
    def _steps(self) -> float:
        """The steps over the part of the span that reach the aim; 0 if unknown."""
        good, bad = self._good, self._bad
        if not good:
            last = self.runs[-1] if self.runs else PilotRun(0, math.inf)
            is_known = last.error < CONVERGING and not self.is_stalled and self.pilots.knows_growth
            return last.n_steps * (last.error / self.pilots.aim) ** (1 / self.order) if is_known else 0
        if bad and good.n_steps > _COARSE * bad.n_steps and self.pilots.needs_reference and not self.is_limited:
            # There may be no possible number of steps between them, and an interpolated number might not reach the aim.
            return min(good.n_steps, _SAME * self._between(bad, good))
        return good.n_steps

    @property
    def error(self) -> float:
        """The expected error with these steps."""
        return self._good.error if self._good and self._good.n_steps == self._steps else self.pilots.aim

    @property
    def mean_evaluations(self) -> float:
        """The evaluations in a step of the run that reaches the aim, or otherwise of the run with the most steps.

        An implicit method takes more iterations in a longer step.
        """
        return (self._good or next(run for run in reversed(self.runs) if math.isfinite(run.error))).evaluations

    @property
    def is_chaotic(self) -> bool:
        """Whether a shorter step hardly extends the time up to which digits are right.

        In a regular motion, an error grows at most with about the square of time. So this time grows at least like
        h^(-1/2), also if kinks of the force reduce the order to 1.
        """
        last = self.runs[-2:]
        is_resolved = all(run.seen_error <= _LARGEST and RESOLVED <= run.right * run.n_steps < math.inf for run in last)
        if len(last) < 2 or not is_resolved or not self.is_settled:
            return False
        coarse, fine = last
        return fine.right / coarse.right < math.sqrt(fine.n_steps / coarse.n_steps)

    @property
    def verdict(self) -> str:
        """How the run with the most steps ended."""
        error = self.runs[-1].error
        return f"its error is {error:.1e}" if math.isfinite(error) else "it is unstable"

    @property
    def without_stable_run(self) -> str:
        jumps = ", or a point may pass through another in a step" if self.pilots.have_jumps else ""
        return f"unstable at every step tried{jumps}"

    @property
    def failure(self) -> str:
        """The reason why the aim is not reached."""
        stable = [run for run in self.runs if math.isfinite(run.error)]
        if not self.runs:
            return NO_TIME
        if any(math.isnan(run.error) for run in self.runs):
            return "nothing moves in any run"
        if not stable:
            return self.without_stable_run
        last = stable[-1]
        if self.is_stalled:
            return f"round-off, or kinks of the force, limit the error to {last.error:.1e}"
        if last.error < CONVERGING and not self.pilots.knows_growth:
            return self.unknown_growth
        h = self.pilots.part * self.pilots.span / last.n_steps
        return (
            f"the error does not converge down to h = {h:.2g}, where it is {last.error:.1e} (chaos, or a step still "
            "too long)"
        )

    @property
    def unknown_growth(self) -> str:
        """The reason why the error of the run with the most steps tells nothing about the whole span."""
        t, last = self.pilots.part * self.pilots.span, self.runs[-1]
        return (
            f"the error is {last.seen_error:.1e} over {t:.3g} time units with h = {t / last.n_steps:.2g}; no longer "
            "run shows how it grows"
        )
