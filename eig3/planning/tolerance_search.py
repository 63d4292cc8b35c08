"""The search for the largest relative tolerance with which a method reaches an accuracy."""

from __future__ import annotations

import math

from ..methods import RK5, RK8, RKN12, Method
from ..stepping.tolerances import LEAST_RTOL
from .pilots import PilotRun, Pilots
from .step_search import NO_TIME, Timed

VARIABLE: tuple[Method, ...] = (RK8(), RKN12(), RK5())  # the methods that are tried with tolerances
_MOST_RUNS = 8
_GOAL = 0.8  # target of the next run, as a fraction of the aim: the error is not a smooth function of rtol
_ENOUGH = 0.5  # an error of at least this fraction of the aim ends the search
_LARGEST_RTOL = 0.1
_LARGEST_FACTOR = 1e4  # largest ratio of the tolerances of consecutive runs
_SLOPES = 0.5, 2.0  # range of the exponent of rtol in the error,
_USUAL_SLOPE = 1.0  # and its usual value
_WORK = 2**24  # work that is always allowed for a run


class ToleranceSearch(Timed):
    """The search for the largest rtol with which a method reaches the aim; it is NaN if none is known.

    `runs` has each trial of rtol, and its run. `failure` is the reason why no rtol is known.
    """

    is_limited = False
    pace = math.inf

    def __init__(self, pilots: Pilots, method: Method) -> None:
        self.pilots, self.method, self.evaluations = pilots, method, pilots.evaluations(method)
        self.label = f"{method.label} with tolerances"
        self.runs: list[tuple[float, PilotRun]] = []
        self.failure = ""

    def run(self, other: Timed, *, longest: float, enough: float = math.inf) -> None:
        """Run until rtol is known. A run takes at most `longest` seconds, or does a small amount of work.

        `other` gives the time of an evaluation. After `enough` seconds of pilot runs, an rtol that reaches the aim is
        not improved.
        """
        pilots, method = self.pilots, self.method
        guess = other.pace / other.evaluations * self.evaluations
        needed = longest * pilots.part
        most = math.ceil(max(needed / guess, _WORK / pilots.work(method, 1)))
        rtol: float | None = min(pilots.aim, _LARGEST_RTOL)
        while rtol and len(self.runs) < _MOST_RUNS:
            if pilots.left < min(needed, most * guess):
                self.failure = self.failure or NO_TIME
                break
            most = min(most, int(pilots.left / guess))
            run = pilots.run_with_tolerance(method, rtol, most)
            if isinstance(run, str):
                self.failure = run
                break
            self.runs.append((rtol, run))
            rtol = None if self._good and pilots.spent > enough else self._next()
        if self._good:
            self.pace = self._good[1].seconds
            self.pace = min(self.pace, self.time_a_step())
        elif self.runs:
            last, run = self.runs[-1]
            self.failure = self.failure or f"its error is {run.error:.1e} with rtol = {last:g}"

    def time_a_step(self) -> float:
        """Seconds of a step, measured in a short run."""
        return self.pilots.time_of_a_step_with_tolerance(self.method, self.rtol, self.steps, self.pace)

    def _next(self) -> float | None:
        """The tolerance of the next run; None if no run is needed."""
        aim, (rtol, run) = self.pilots.aim, self.runs[-1]
        if _ENOUGH * aim <= run.error <= aim:
            return None
        slope = _USUAL_SLOPE
        if len(self.runs) > 1:
            before, other = self.runs[-2]
            least, most = _SLOPES
            observed = math.log(_positive(run.error) / _positive(other.error)) / math.log(rtol / before)
            slope = min(most, max(least, observed))
        factor = (_GOAL * aim / _positive(run.error)) ** (1 / slope)
        wanted = rtol * min(_LARGEST_FACTOR, max(1 / _LARGEST_FACTOR, factor))
        # A part of the span is less reliable: elsewhere, other motions may control the steps.
        largest = _LARGEST_RTOL if self.pilots.part == 1 else min(aim, _LARGEST_RTOL)
        wanted = max(LEAST_RTOL, float(f"{min(wanted, largest):.2g}"))
        return None if any(wanted == tried for tried, _ in self.runs) else wanted

    @property
    def _good(self) -> tuple[float, PilotRun] | None:
        """The run with the largest tolerance such that it and all runs with smaller tolerances reach the aim."""
        found = None
        for rtol, run in sorted(self.runs, key=lambda entry: entry[0]):
            if not run.error <= self.pilots.aim:
                break
            found = rtol, run
        return found

    @property
    def rtol(self) -> float:
        return self._good[0] if self._good else math.nan

    @property
    def steps(self) -> int:
        """The steps over the whole span; 0 if unknown."""
        return math.ceil(self._good[1].n_steps / self.pilots.part) if self._good else 0

    @property
    def error(self) -> float:
        return self._good[1].error if self._good else math.nan

    @property
    def mean_evaluations(self) -> float:
        """The evaluations for each step, including the evaluations of rejected steps."""
        return self._good[1].evaluations if self._good else math.nan


def _positive(error: float) -> float:
    return max(error, 1e-300)
