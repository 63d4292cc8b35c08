"""Pilot runs: runs of any method with a known error, over the span of a problem or over a part of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import check_params, check_state
from ..methods import Method
from ..problem import Problem
from ..quantities import Quantity, as_extremes
from ..solution import Solution, Status
from ..stepper import Stepper
from ..watched_stepper import WatchedStepper

FEWEST = 61  # fewest steps of a run. A prime number: states at multiples of a period would hide an error of phase
_STATES = 976  # most states at which two runs are compared, 16 times the fewest,
_VALUES = 2**18  # or fewer, so that they have no more values than this
_STEPS_PER_STATE = 16  # fewest steps from one of these states to the next, in a run of many steps
_FOLLOWED = 2**22  # most values in the states of a run whose energy is followed
_PIECES = 32  # of a run, after each of which it is checked,
_PIECE = 512  # fewest steps of such a piece: the call takes as long as some ten steps
_DIVERGED = 100.0  # a motion that is larger than the reference by this factor is unstable
_AT_REST = 1e-150  # a motion below this has decayed
_SHORT = 0.005  # a run that takes less time, s, is repeated,
_VERY_SHORT = 0.0005  # and more often if it takes less than this
_LONGEST_TIMED = 0.02  # longest run that measures the time of a step, s
_IMPLICIT = 2  # fewest evaluations per step of an implicit method
_CALL = 16  # an evaluation takes as long as for this number of degrees of freedom more in a long vector


@dataclass(frozen=True)
class History:
    """What a run took, and the states to compare or the largest change of the energy."""

    seconds: float
    n_rhs: float
    u: np.ndarray
    drift: float


@dataclass(frozen=True)
class Run:
    """A run: its steps over the part of the span, its error over the whole span, and the cost of a step."""

    n_steps: int
    error: float  # infinite if the run diverged
    seconds: float = math.nan
    evaluations: float = math.nan


class Pilots:
    """The pilot runs of all methods on one problem.

    For the metric "energy", a run gives its error itself, from all its steps or, in a large system, many of them. For
    "trajectory", the error is the difference from the run that `refer_to` sets, at states that both runs have: the
    numbers of steps are multiples of `FEWEST`.

    Attributes
    ----------
    problem : Problem
    aim : float
        The error to reach.
    part : float
        The part of the span that is run.
    span : float
    needs_reference : bool
    """

    def __init__(self, problem: Problem, metric: str, aim: float) -> None:
        self.problem, self.aim, self.part = problem, aim, 1.0
        self.span = problem.t_span[1] - problem.t_span[0]
        self.needs_reference = metric == "trajectory"
        self._begin = time.perf_counter()
        self._compiled: set[tuple[Method, str]] = set()
        self._events = {name: event for name, event in problem.events.items() if event.apply is not None}
        self._reference: np.ndarray | None = None
        self._size = math.inf
        zeros = np.zeros(0 if self.needs_reference else len(problem.integrals))
        u0, v0 = (np.append(x, zeros) if zeros.size else x for x in (problem.u0, problem.v0))
        self._u0, self._v0, self._form = check_state(u0, v0)
        most = min(_STATES, max(FEWEST, _VALUES // np.size(problem.u0)))
        self._states = FEWEST * 2 ** int(math.log2(most / FEWEST))
        self._energy = None
        if metric == "energy":
            self._energy = Quantity("energy", problem.energy, form=self._form)

    @property
    def spent(self) -> float:
        """The time since the start, s, without compilation."""
        return time.perf_counter() - self._begin

    def evaluations(self, method: Method) -> int:
        """The evaluations in a step, at least."""
        running = method.for_force(self.problem.uses_velocity, np.size(self.problem.u0))
        return running.evaluations or _IMPLICIT

    def work(self, method: Method, n_steps: float) -> float:
        """The work of a run, in evaluations of one degree of freedom in a long vector."""
        return n_steps * self.evaluations(method) * (_CALL + np.size(self.problem.u0))

    def refer_to(self, history: History) -> None:
        """Let the error of each run be its difference from this one."""
        self._reference = history.u
        self._size = float(max(np.abs(history.u).max(), np.abs(self._u0).max()))

    def run(self, method: Method, n_steps: int) -> Run:
        """Run a method over the part of the span."""
        history = self.history(method, n_steps)
        if history is None:
            return Run(n_steps, math.inf)
        run = self.judged(n_steps, history)
        # Following the energy takes time, and what else the machine does may take longer than a short run.
        if self._energy or history.seconds < _SHORT:
            for _ in range(4 if history.seconds < _VERY_SHORT else 1):
                again = self._advance(method, self.part * self.span / n_steps, n_steps, n_steps)
                run = replace(run, seconds=min(run.seconds, again.seconds / n_steps)) if again else run
        return run

    def history(self, method: Method, n_steps: int) -> History | None:
        """Run a method over the part of the span, and follow what gives the error; None if the run diverges."""
        self._compile(method, "h", lambda: self._advance(method, 1e-9 * self.span, 1, 1))
        h = self.part * self.span / n_steps
        if self._energy:
            return self._advance(method, h, n_steps, math.ceil(n_steps * np.size(self._u0) / _FOLLOWED), follow=True)
        states = FEWEST
        while states < self._states and n_steps % (2 * states) == 0:
            states *= 2
        return self._advance(method, h, n_steps, n_steps // states)

    def run_with_tolerance(self, method: Method, rtol: float, most: int) -> Run | str:
        """Run a method with tolerances over the part of the span, in at most `most` steps; if it fails, say why."""
        self._compile(method, "rtol", lambda: self._solve(method, rtol, 1))
        solution = self._solve(method, rtol, most, follow=True)
        if solution.status is Status.TOO_MANY_STEPS:
            return f"with rtol = {rtol:g} it takes more than {most} steps"
        if not solution.success:
            return solution.message
        drift = solution.drift["energy"] / abs(self._start_energy) if self._energy else 0.0
        return self.judged(solution.n_steps, History(solution.kernel_seconds, solution.n_rhs, solution.u, drift))

    def judged(self, n_steps: int, history: History) -> Run:
        """The run of this history, with its error extrapolated to the whole span."""
        error, growth = self._trajectory_error(history.u) if self.needs_reference else (history.drift, 1.0)
        return Run(n_steps, error * (1 / self.part) ** growth, history.seconds / n_steps, history.n_rhs / n_steps)

    def time_of_a_step(self, method: Method, total: int, pace: float) -> float:
        """Seconds, measured in a short run with the step of `total` steps over the span; `pace` is an estimate."""
        count = max(1, min(total, int(_LONGEST_TIMED / pace)))
        history = self._advance(method, self.span / total, count, save_every(self.problem, total))
        return history.seconds / count if history else math.inf

    def time_of_a_step_with_tolerance(self, method: Method, rtol: float, total: int, pace: float) -> float:
        """Seconds, measured in a short run; `total` is the number of steps over the span, `pace` an estimate."""
        every = save_every(self.problem, total)
        solution = self._solve(method, rtol, max(1, int(_LONGEST_TIMED / pace)), every=every)
        return solution.kernel_seconds / solution.n_steps

    def possible(self, n_steps: float) -> int:
        """The number of steps close to `n_steps` with which there are enough states to compare."""
        n_steps = max(n_steps, FEWEST)
        if not self.needs_reference:
            return round(n_steps)
        unit = min(self._states, FEWEST * 2 ** max(0, int(math.log2(n_steps / _STEPS_PER_STATE / FEWEST))))
        return unit * round(n_steps / unit)

    def _advance(self, method: Method, h: float, n_steps: int, every: int, *, follow: bool = False) -> History | None:
        """Run in several pieces, and stop as soon as the run has diverged.

        Each `every`-th state is kept or, with `follow`, only its energy.
        """
        stepper = self._stepper(method, h, n_steps)
        states = n_steps // every
        each = max(math.ceil(_PIECE / every), math.ceil(states / _PIECES))
        shape = each if follow else states, *np.shape(self._u0)
        u, v = np.empty(shape), np.empty(shape)
        drift = 0.0
        while stepper.index < n_steps:
            first = stepper.index // every
            count = min(each * every, n_steps - stepper.index)
            rows = slice(0, count // every) if follow else slice(first, first + count // every)
            taken = stepper.advance(count, every, u[rows], v[rows])
            if taken < count or not stepper.is_finite or stepper.sizes[0] > _DIVERGED * self._size:
                return None
            if follow:
                drift = max(drift, self._drift(first + 1, h * every, u[rows], v[rows]))
            elif 0 < max(stepper.sizes) < _AT_REST:  # a step with subnormal numbers takes a hundred times as long
                u[rows.stop :] = 0.0
                break
        whole = n_steps / stepper.index
        return History(stepper.seconds * whole, stepper.n_rhs * whole, u, drift)

    def _stepper(self, method: Method, h: float, n_steps: int) -> Stepper:
        """Return a stepper at the start, which follows the events that change the motion."""
        t0 = self.problem.t_span[0]
        options: dict[str, Any] = {"h": h, "t0": t0, "params": self.problem.params, "method": method}
        if not self._events:
            return Stepper(self.problem.rhs, self._u0, self._v0, **options)
        options |= {"t_end": t0 + n_steps * h, "events": self._events, "t_eval": None}
        return WatchedStepper(self.problem.rhs, self._u0, self._v0, **options)

    def _solve(
        self, method: Method, rtol: float, most: int, *, follow: bool = False, every: int | None = None
    ) -> Solution:
        """Run with tolerances over the part of the span; with `follow`, keep what gives the error."""
        t0, end = self.problem.t_span
        if self.part < 1:
            end = t0 + self.part * self.span
        options: dict[str, Any] = {"save_every": every, "events": self._events}
        if follow and self.needs_reference:
            assert self._reference is not None
            options["t_eval"] = np.linspace(t0, end, len(self._reference) + 1)[1:]
        if not (follow and self._energy):
            options["invariants"] = {}
        return self.problem.integrate(rtol=rtol, method=method, t_end=end, max_steps=most, **options)

    def _compile(self, method: Method, argument: str, run: Callable[[], Any]) -> None:
        """Compile a method by a first run, whose time does not count."""
        if (method, argument) not in self._compiled:
            self._compiled.add((method, argument))
            begin = time.perf_counter()
            run()
            self._begin += time.perf_counter() - begin

    @property
    def _start_energy(self) -> float:
        return float(self.problem.energy_of(self.problem.u0, self.problem.v0))

    def _drift(self, first: int, spacing: float, u: np.ndarray, v: np.ndarray) -> float:
        """The largest relative change of the energy over states with this spacing."""
        assert self._energy is not None
        t0, params = self.problem.t_span[0], check_params(self.problem.params)
        extremes = self._energy.no_extremes()
        start = self._energy.at_start(t0, self._u0, self._v0, params, extremes)
        t = t0 + spacing * np.arange(first, first + len(u))
        self._energy.evaluate(t, u, v, params, extremes)
        low, high, *_ = as_extremes(extremes, self._energy.shape)
        return max(start - low, high - start) / abs(start)

    def _trajectory_error(self, u: np.ndarray) -> tuple[float, float]:
        """The error, and the power of time with which it grows."""
        assert self._reference is not None
        both = math.gcd(len(u), len(self._reference))
        u, known = (x[len(x) // both - 1 :: len(x) // both] for x in (u, self._reference))
        errors = np.abs(u - known).reshape(both, -1).max(axis=1) / self._size
        error, half = float(errors.max()), float(errors[: both // 2].max())
        return error, min(2.0, max(0.0, math.log2(error / half))) if half > 0 else 1.0


def save_every(problem: Problem, n_steps: int) -> int:
    """The `save_every` with which a run keeps about 2000 states, or fewer of a large system."""
    most = min(2048, max(64, _VALUES // np.size(problem.u0)))
    return 2 ** max(0, (n_steps // most).bit_length() - 1)
