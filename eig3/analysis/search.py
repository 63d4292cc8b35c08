"""The search for the longest step with which a method reaches an accuracy."""

from __future__ import annotations

import math
from typing import Protocol

from ..methods import RK8, Method
from .pilots import FEWEST, History, Pilots, Run

GUIDE = RK8()
_AGREEMENT = 0.25  # two runs that differ by this fraction of the accuracy give a reference
_AGREEMENT_AT_MOST = 0.05  # runs with a larger relative difference may both be wrong
#: Parts of the span to run, and the time that RK8 may take over each of them,
_PARTS = {1.0: 0.3, 1 / 16: 0.15, 1 / 256: 0.15, 1 / 4096: 0.15}
_GUIDE_WORK = 2**26  # and the work that it may do in any case
_MOST_RUNS = 24  # of a method
_CONVERGING = 0.2  # from a relative error above this, the error at a smaller step cannot be predicted
_NEAR = 1.06  # the longest step is found to this factor,
_ENOUGH = 0.7  # or until the error is at least this fraction of the aim
_COARSE = 1.1  # between two steps this far apart, the longest step is interpolated
_SAME = 1.04  # steps closer than this need no run
_LARGEST = 2.0  # the relative error of two motions of the same size that have nothing in common
_APART = 1.2  # ratio of two steps from which on the change of the error shows a power of the step
_STEEP = 2.0  # an error that grows with more than this multiple of its order is one of stability
_ROUND_OFF = 1e-6  # an error below this is round-off if it falls with a power of the step
_STALLED = 0.5  # below this
_LEAST = 5e-14  # runs may agree to less than this by chance only


def guide(pilots: Pilots) -> Search | str:
    """Find a reference, and the runs of RK8 that lead to it; if there is none, the reason why."""
    if pilots.aim < _LEAST:
        return "the accuracy is below round-off"
    shortest = math.inf  # of the steps that were unstable over a longer part
    for pilots.part, seconds in _PARTS.items():
        search = Search(pilots, GUIDE)
        found = _double(search, seconds)
        stable = [run.n_steps for run in search.runs if math.isfinite(run.error)]
        if stable and shortest < pilots.part * pilots.span / stable[0]:
            return "unstable at every step tried"  # over the longer part
        if found:
            return search
        if search.runs and not stable:
            shortest = pilots.part * pilots.span / search.runs[-1].n_steps
    return search.failure


def _double(search: Search, allowed: float) -> bool:
    """Double the steps until the error is known and far below the aim; return whether this is reached."""
    pilots, method = search.pilots, search.method
    until, work, seconds, n_steps = pilots.spent + allowed, 0.0, 0.0, FEWEST
    coarse: History | None = None
    while work + pilots.work(method, n_steps) < _GUIDE_WORK or pilots.spent + 2 * seconds < until:
        begin = pilots.spent
        fine = pilots.history(method, n_steps)
        seconds = pilots.spent - begin
        work += pilots.work(method, n_steps)
        if fine is None:
            search.add(Run(n_steps, math.inf))
        elif not pilots.needs_reference:
            search.add(pilots.judged(n_steps, fine))
        elif coarse:
            pilots.refer_to(fine)
            search.add(pilots.judged(n_steps // 2, coarse))
        if search.runs and search.runs[-1].error <= min(_AGREEMENT * pilots.aim, _AGREEMENT_AT_MOST):
            return True
        if search.is_stalled:
            return False
        coarse = fine
        n_steps *= 2
    return False


class Timed(Protocol):
    """A search whose cost is known: the evaluations and seconds of a step, and the seconds of the whole run."""

    evaluations: int

    @property
    def pace(self) -> float: ...

    @property
    def seconds(self) -> float: ...


class Search:
    """The search for the longest step with which a method reaches the aim."""

    rtol = None

    def __init__(self, pilots: Pilots, method: Method) -> None:
        self.pilots, self.method, self.evaluations = pilots, method, pilots.evaluations(method)
        self.label = method.label
        self.runs: list[Run] = []  # from the fewest steps to the most

    def add(self, run: Run) -> None:
        self.runs = sorted([*self.runs, run], key=lambda run: run.n_steps)

    def run(self, other: Timed, *, longest: float = math.inf, until: float = math.inf, work: float = 0.0) -> None:
        """Run until the longest step is known, or the next run would take too long.

        The first run takes as long as `other` takes to reach the aim. A run takes at most `longest` seconds and ends
        before the pilot runs have taken `until` seconds, unless it is within the remaining `work`.
        """
        guess = other.pace / other.evaluations * self.evaluations
        n_steps = self._next() if self.runs else other.seconds / guess * self.pilots.part
        while n_steps and len(self.runs) < _MOST_RUNS:
            pace = self.pace if math.isfinite(self.pace) else guess
            allowed = min(longest, until - self.pilots.spent)
            most = max(allowed / pace * self.pilots.part, work / self.pilots.work(self.method, 1))
            n_steps = self.pilots.possible(min(n_steps, most))
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
    def _bad(self) -> Run | None:
        """The run with the most steps that does not reach the aim."""
        return next((run for run in reversed(self.runs) if not run.error <= self.pilots.aim), None)

    @property
    def _good(self) -> Run | None:
        """The run with the fewest steps from which on every run reaches the aim."""
        bad = self._bad
        return next((run for run in self.runs if not bad or run.n_steps > bad.n_steps), None)

    def _next(self) -> float | None:
        """The steps of the next run, before they are rounded; None if no run is needed."""
        good, bad, aim = self._good, self._bad, self.pilots.aim
        if not good:
            last = self.runs[-1]
            if self.is_stalled:
                return None
            factor = min(4.0, 1.05 * (last.error / aim) ** (1 / self.order)) if last.error < _CONVERGING else 1.5
            return max(factor, _NEAR) * last.n_steps
        if not bad:
            factor = max(1 / 4, 0.97 * (good.error / aim) ** (1 / self.order))
            return min(factor, 1 / _NEAR) * good.n_steps
        ratio = good.n_steps / bad.n_steps
        if ratio < _NEAR or good.error > _ENOUGH * aim:
            return None
        between = self._between(bad, good) if bad.error < _CONVERGING else math.sqrt(ratio) * bad.n_steps
        return max(between, 1.001 * _SAME * bad.n_steps)

    def _between(self, bad: Run, good: Run) -> float:
        """The steps with which the error is just below the aim, if it is a power of the step."""
        return 1.01 * bad.n_steps * (bad.error / self.pilots.aim) ** (1 / self._slope(bad, good))

    def _slope(self, bad: Run, good: Run) -> float:
        return math.log(bad.error / max(good.error, 1e-300)) / math.log(good.n_steps / bad.n_steps)

    @property
    def order(self) -> float:
        """The order of convergence over the two runs with the most steps, or else that of the method."""
        known = float(self.method.order)
        return min(2 * known, max(known / 2, self._observed)) if self._observed else known

    @property
    def _observed(self) -> float | None:
        converging = [run for run in self.runs if run.error < _CONVERGING][-2:]
        return self._slope(*converging) if len(converging) == 2 else None

    @property
    def follows_order(self) -> bool:
        """Whether the error falls with the step as the order predicts, so that it can be extrapolated."""
        return self._observed is not None and not self.is_limited and not self.is_stalled

    @property
    def is_limited(self) -> bool:
        """Whether stability limits the step: with a longer one, the error grows much faster than by the order."""
        if not self._bad:
            return False
        fine = self._good or self.runs[-1]
        coarse = next((run for run in reversed(self.runs) if _APART * run.n_steps < fine.n_steps), None)
        if coarse is None:
            return self._bad.error > _LARGEST
        return coarse.error > _LARGEST or self._slope(coarse, fine) > _STEEP * (self.method.order + 1)

    @property
    def is_stalled(self) -> bool:
        """Whether round-off keeps the error from falling."""
        before = self.runs[-2].error if len(self.runs) > 1 else math.inf
        return before < _ROUND_OFF and (self._observed or 0.0) < _STALLED

    @property
    def steps(self) -> int:
        """The steps over the whole span that reach the aim; 0 if unknown."""
        return math.ceil(self._steps / self.pilots.part)

    @property
    def _steps(self) -> float:
        """The steps over the part of the span that reach the aim; 0 if unknown."""
        good, bad = self._good, self._bad
        if not good:
            last = self.runs[-1] if self.runs else Run(0, math.inf)
            extrapolated = last.error < _CONVERGING and not self.is_stalled
            return last.n_steps * (last.error / self.pilots.aim) ** (1 / self.order) if extrapolated else 0
        if bad and good.n_steps > _COARSE * bad.n_steps and self.pilots.needs_reference and not self.is_limited:
            # No number of steps between them may be possible. An interpolated one might not reach the aim.
            return min(good.n_steps, _SAME * self._between(bad, good))
        return good.n_steps

    @property
    def seconds(self) -> float:
        """The predicted time; infinite if unknown."""
        return self.steps * self.pace if self.steps else math.inf

    @property
    def reaches(self) -> bool:
        """Whether a run has reached the aim."""
        return self._good is not None

    @property
    def error(self) -> float:
        """The error expected with these steps."""
        return self._good.error if self._good and self._good.n_steps == self._steps else self.pilots.aim

    @property
    def mean_evaluations(self) -> float:
        """The evaluations in a step of the run with the most steps."""
        return next(run.evaluations for run in reversed(self.runs) if math.isfinite(run.error))

    @property
    def verdict(self) -> str:
        """How the run with the most steps ended."""
        error = self.runs[-1].error
        return f"its error is {error:.1e}" if math.isfinite(error) else "it is unstable"

    @property
    def failure(self) -> str:
        """Why the aim is not reached."""
        stable = [run for run in self.runs if math.isfinite(run.error)]
        if not self.runs:
            return "two runs of a small part of the span take too long"
        if not stable:
            return "unstable at every step tried"
        last = stable[-1]
        if self.is_stalled:
            return f"round-off leaves an error of {last.error:.1e}"
        h = self.pilots.part * self.pilots.span / last.n_steps
        return (
            f"the error does not converge down to h = {h:.2g}, where it is {last.error:.1e} (chaos, or a step still "
            "too long)"
        )
