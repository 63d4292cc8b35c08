"""Pilot runs: runs of any method with a known error, over the span of a problem or over a part of it.

Their processor time is bounded, which does not depend on the load of the machine.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..diagnosis.coarseness import h_without_jumps
from ..diagnosis.critical import NoCriticalStepError, of_encounters
from ..diagnosis.linearisation import fast_rates
from ..functions.callbacks import Callback, check_callback
from ..functions.checks import check_params, check_state
from ..functions.evaluation import energies
from ..functions.guard import guarded
from ..methods import EIG3, Method
from ..problem import Problem
from ..result.solution import Solution, Status
from ..stepping.run_options import RunOptions
from ..stepping.stepper import Stepper
from ..stepping.system import System

FEWEST = 61  # least number of steps of a run, a prime: states at multiples of a period would hide a phase error
_STATES = 976  # largest number of states at which two runs are compared, 16 times the least number,
_VALUES = 2**18  # or fewer states, with at most this number of values
_STEPS_PER_STATE = 16  # least number of steps between these states, in a run of many steps
_FOLLOWED = 2**22  # largest number of values in the states of a run whose energy is computed
_PIECES = 32  # pieces of a run, which is checked after each,
_PIECE = 512  # with at least this number of steps: the call takes as long as some ten steps,
_FIRST_PIECE = 8  # or first with this number, because each step of an unstable run may have many events,
_SLOW_STEP = 1e-3  # or first up to the first state if a step takes more than this time, s: later, it may take longer
_SAME_SPEED = 1.6  # largest ratio of the speeds of two runs that may show the same motion
_DIVERGED = 100.0  # a motion that is larger than the reference by this factor is unstable
_AT_REST = 1e-150  # a motion below this has decayed
_SHORT = 0.005  # a run that takes less time, s, is repeated,
_VERY_SHORT = 0.0005  # and a shorter run more often
_LONGEST_TIMED = 0.02  # longest run that measures the time of a step, s
_IMPLICIT = 2  # least number of evaluations per step of an implicit method
_CALL = 16  # overhead of an evaluation, in degrees of freedom of a long vector
_COMPARED = 31  # states at which a run with tolerances is compared with the reference
_ABOVE_ROUND_OFF = 1e-10  # relative error of a step that round-off does not change
_LATEST = 10.0  # processor time, s, after which no optional run begins
_LONGEST_PIECE = 0.25  # time of a piece of a run, s
CONVERGING = 0.2  # above this relative error, the error at a smaller step cannot be predicted
TELLING = 0.01  # above this relative error, a run does not show how errors grow with time: it may be close to unstable
_STILL = 1e-9  # a smaller path relative to the displacement is round-off: nothing has moved
_REST = 1e-3  # with a smaller acceleration at the start, relative to the largest one, the motion begins later


@dataclass(frozen=True)
class PilotStates:
    """The cost of a run, some of its states and, if computed, the largest change of the energy.

    If a run was stopped early, `seconds` and `n_rhs` are extrapolated. With tolerances, h is not a number.
    """

    seconds: float
    n_rhs: float
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    drift: float
    is_whole: bool
    method: Method
    h: float = math.nan


@dataclass(frozen=True)
class PilotRun:
    """A run: its steps and error over the part of the span, its error over the whole span, and the cost of a step.

    `right` is the fraction of the part up to which the error is at most `CONVERGING`; infinity if it always is.
    """

    n_steps: int
    error: float  # infinite if the run diverged
    seconds: float = math.nan
    evaluations: float = math.nan
    seen_error: float = math.inf  # over the part
    right: float = math.inf


class Pilots:
    """The pilot runs of all methods on one problem.

    For the metric "energy", the error of a run is its energy drift, over all steps or, in a large system, over many
    steps. For "trajectory", the error is the difference from the exact motion if this is known, and otherwise from the
    reference run set by `refer_to`, at common states: the numbers of steps are multiples of `FEWEST`. It is relative to
    the largest known displacement, of the whole span after a survey.

    Attributes
    ----------
    problem : Problem
    aim : float
        The error to reach.
    span : float
    part : float
        The length of the pilot runs as a fraction of the span.
    window : tuple of float
        The beginning and the end of the pilot runs.
    needs_reference : bool
    have_jumps : bool
        Whether a run has ended because a point may pass through another in a step.
    compiling : float
        The compilation time, s.
    least_power : float
        Errors are extrapolated with this power of time, or with a larger one that they show in the window.
    knows_growth : bool
        Whether runs over the whole span, or over longer parts, have shown how errors grow with time.
    at_start : tuple
        u and v at the start of the span, with first-order unknowns where they are needed.
    """

    def __init__(self, problem: Problem, metric: str, aim: float) -> None:
        self.problem, self.aim = problem, aim
        self.span = problem.t_span[1] - problem.t_span[0]
        self.needs_reference = metric == "trajectory"
        self.have_jumps = False
        self.compiling = 0.0
        self._begin = time.thread_time()
        self._paces: dict[Method, float] = {}  # processor time of a step in the last run of each method
        self._compiled: set[tuple[Method, str]] = set()
        self._events = {name: event for name, event in problem.events.items() if event.apply is not None}
        self._survey: PilotStates | None = None
        self._seen: PilotStates | None = None  # the last run of the reference method
        self._reference: PilotStates | None = None  # the reference run, with the exact displacements if they are known
        self._growth: float | None = None  # ratio of the errors over the whole span and in the window, if known
        self.least_power, self.knows_growth = 0.0, True
        self._largest = math.inf  # a motion that is larger is unstable
        self._sizes = -np.ones(2)  # the largest |u| and |v| of the motion; negative if none is known
        self._moves: Any = slice(None)  # events write the degrees of freedom that do not move, whose units differ
        u0, v0 = problem.u0, problem.v0
        if problem.z0 and (problem.unknowns.is_read or not self.needs_reference):
            u0, v0 = problem.start
        u0, v0, self._form = check_state(u0, v0)
        self.at_start = u0, v0
        most = min(_STATES, max(FEWEST, _VALUES // np.size(problem.u0)))
        self._states = FEWEST * 2 ** int(math.log2(most / FEWEST))
        self._energy: Callback | None = None
        if metric == "energy":
            self._energy = check_callback(problem.energy, "invariant", self._form, "energy")
        self._look_from(problem.t_span[0], u0, v0, 1.0)
        self._first_acceleration = math.nan  # the largest at the start, known from the first run

    @property
    def spent(self) -> float:
        """The processor time since the start, s, without compilation."""
        return time.thread_time() - self._begin

    @property
    def left(self) -> float:
        """The processor time that is left for runs, s."""
        return _LATEST - self.spent

    @property
    def seen(self) -> float:
        """The time up to which a run has shown the motion."""
        return max(self.window[1], self.problem.t_span[0] if self._survey is None else float(self._survey.t[-1]))

    def evaluations(self, method: Method) -> int:
        """The least number of evaluations in a step."""
        running = method.for_force(self.problem.uses_velocity, np.size(self.problem.u0))
        return running.evaluations or _IMPLICIT

    def fewest(self, method: Method) -> float:
        """The steps over the whole span for stable collisions of points, which the runs may not contain."""
        try:
            return 0.0 if self._ahead is None else self.span / of_encounters(self._ahead, method).h
        except NoCriticalStepError:
            return 0.0

    @cached_property
    def _ahead(self) -> Any:
        return self.problem.ahead(self.problem.t_span[0])

    def work(self, method: Method, n_steps: float) -> float:
        """The work of a run, in evaluations of one degree of freedom in a long vector."""
        return n_steps * self.evaluations(method) * (_CALL + np.size(self.problem.u0))

    def stable_steps(self, method: Method, longest: float) -> int:
        """The least number of steps, doubled from `FEWEST`, that is stable at the beginning of the pilot runs.

        `longest` is the longest stable step as a multiple of the shortest time constant of the linearised system.
        """
        span = self.part * self.span
        f = self._stepper(method, span).evaluator()
        rates = fast_rates(f, self.window[0], self._u0, self._v0, span / FEWEST)
        return FEWEST * 2 ** math.ceil(math.log2(max(1.0, np.abs(rates).max() / longest)))

    def predicted(self, method: Method, n_steps: float) -> float:
        """The processor time of a run, s, predicted from the last run of the method or from a few short steps."""
        if method not in self._paces:
            self._compile(method, "h", lambda: self._advance(method, 1e-9 * self.span, 1, 1))
            self._advance(method, 1e-9 * self.span, 1, 1)
            count = min(_PIECE, int(_LONGEST_TIMED / self._paces[method]))
            if count > 1:  # a call with one short step takes a hundred times as long as this step
                self._advance(method, 1e-9 * self.span, count, count)
        return n_steps * self._paces[method]

    def refer_to(self, history: PilotStates) -> None:
        """Set the reference for the errors of runs; the exact motion is used instead if it is known."""
        exact = self.problem.exact if self.window[0] == self.problem.t_span[0] else None
        self._reference = replace(history, u=exact(history.t)[0]) if exact else history
        self.note_sizes(history)

    def note_sizes(self, history: PilotStates) -> None:
        """Make errors relative to the displacements of this run, or of the whole span if they are larger."""
        self._seen = history
        if self.part == 1:
            self._survey = history
        if np.ndim(history.v) > 1:
            self._moves = np.any(self._motion(history.v) != 0, axis=0)
        known = 0.0 if self._survey is None else self._sizes_of(self._survey)
        self._sizes = np.maximum(self._sizes_of(history), known)

    def have_one_speed(self, *runs: PilotStates) -> bool:
        """Whether runs are about as fast: with too long a step, a motion can gain energy once, and leave its place."""
        speeds = [self._sizes_of(run)[1] for run in runs]
        return max(speeds) <= _SAME_SPEED * min(speeds)

    def trust(self) -> None:
        """Trust the reference: a run with a much larger motion then counts as unstable."""
        assert self._seen is not None
        written = float(np.abs(self._motion(self._seen.u)).max())  # also by events
        self._largest = math.inf if math.isnan(self.size) else _DIVERGED * max(self.size, written)

    @property
    def is_surveyed(self) -> bool:
        """Whether states of a run from the start of the span are known."""
        return self._survey is not None

    def states(self, count: int, h: float) -> Iterator[tuple[float, Any, Any, float]]:
        """Return some known states of the whole span, each with the step h."""
        survey = self._survey
        if survey is None:
            return
        for i in np.linspace(0, len(survey.t), count, endpoint=False).astype(int):
            yield survey.t[i], survey.u[i], survey.v[i], h

    @property
    def acceleration(self) -> Callable[[float, Any, Any], Any]:
        """The function f(t, u, v)."""
        return self._stepper(EIG3(), self.span).evaluator()

    def forget_survey(self) -> None:
        """Discard the states of runs of the whole span, because they are unstable."""
        if self.part == 1:
            self._survey = None

    def calibrate(self, method: Method, whole: PilotRun) -> None:
        """Find the ratio of an error over the whole span to the error in the window, from runs with the same steps.

        `whole` is a run of the whole span. If this is not possible, errors are extrapolated with the power of time that
        they show within the window.
        """
        n_steps = round(whole.n_steps * self.part)
        if n_steps < FEWEST or n_steps != whole.n_steps * self.part or not whole.error < CONVERGING:
            return
        coarse, fine = self.history(method, n_steps), self.history(method, 2 * n_steps)
        if coarse is None or fine is None:
            return
        self.refer_to(fine)
        error, *_ = self._error(coarse)
        if error > 0:
            self._growth, self.knows_growth = max(1.0, whole.error / error), True

    def note_growth(self, short: Sequence[PilotRun], part: float, run: PilotRun) -> None:
        """Extrapolate with the power of time that a run over a longer part shows beside a run with the same steps.

        The ratio to the error over the whole span is better, if it is known.
        """
        same = run.n_steps * self.part / part
        for each in short if self._growth is None else ():
            if each.n_steps == same and each.seen_error > 0 and 0 < run.seen_error < TELLING:
                power = math.log(run.seen_error / each.seen_error) / math.log(part / self.part)
                self.least_power, self.knows_growth = max(self.least_power, min(2.0, power)), True

    def look_at(self, part: float) -> None:
        """Restrict the next runs to a part of the span: after a survey, to the part with the fastest motion."""
        t0, u0, v0 = self.problem.t_span[0], *self.at_start
        if part < 1 and self._survey is not None:
            survey = self._survey
            t = np.append(t0, survey.t)
            v = self._motion(np.concatenate([[v0], survey.v]))
            speeds = np.abs(v.reshape(len(t), -1)).max(axis=1)
            rows = np.arange(np.searchsorted(t, t[-1] - part * self.span, side="right"))
            ends = np.maximum(np.searchsorted(t, t[rows] + part * self.span), rows + 1)
            total = np.append(0.0, np.cumsum(speeds))
            if rows.size:
                first = int(np.argmax((total[ends + 1] - total[rows]) / (ends + 1 - rows)))
                if first > 0:
                    t0, u0, v0 = t[first], survey.u[first - 1], survey.v[first - 1]
        self._reference, self._growth, self.least_power, self.knows_growth = None, None, 0.0, False
        self._look_from(t0, u0, v0, part)

    def _look_from(self, t0: float, u0: Any, v0: Any, part: float) -> None:
        end = self.problem.t_span[1] if part == 1 else t0 + part * self.span
        self.part, self.window = part, (float(t0), float(end))
        self._u0, self._v0 = u0, v0

    def run(self, method: Method, n_steps: int) -> PilotRun:
        """Run a method over the part of the span."""
        history = self.history(method, n_steps)
        if history is None:
            return PilotRun(n_steps, math.inf)
        run = self.judged(n_steps, history)
        # Computing the energy takes time, and other processes may take longer than a short run.
        if self._energy or history.seconds < _SHORT:
            for _ in range(4 if history.seconds < _VERY_SHORT else 1):
                again = self._advance(method, self.part * self.span / n_steps, n_steps, n_steps)
                run = replace(run, seconds=min(run.seconds, again.seconds / n_steps)) if again else run
        return run

    def history(self, method: Method, n_steps: int, longest: float = math.inf) -> PilotStates | None:
        """Run a method over the part of the span, and collect the data for its error; None if the run diverges.

        The run stops after `longest` seconds of processor time.
        """
        self._compile(method, "h", lambda: self._advance(method, 1e-9 * self.span, 1, 1))
        h = self.part * self.span / n_steps
        if self._energy:
            every = math.ceil(n_steps * np.size(self._u0) / _FOLLOWED)
            return self._advance(method, h, n_steps, every, longest, follow=True)
        states = FEWEST
        while states < self._states and n_steps % (2 * states) == 0:
            states *= 2
        return self._advance(method, h, n_steps, n_steps // states, longest)

    def run_with_tolerance(self, method: Method, rtol: float, most: int) -> PilotRun | str:
        """Run a method with tolerances over the part of the span, in at most `most` steps; if it fails, say why."""
        self._compile(method, "rtol", lambda: [self._solve(method, rtol, 1, follow=follow) for follow in (True, False)])
        solution = self._solve(method, rtol, most, follow=True)
        if solution.status is Status.TOO_MANY_STEPS:
            return f"with rtol = {rtol:g} it takes more than {most} steps"
        if not solution.success:
            return solution.message
        drift = solution.drift["energy"] / abs(self._start_energy) if self._energy else 0.0
        n_rhs = self.evaluations(method) * (solution.n_steps + solution.n_rejected)
        history = PilotStates(solution.kernel_seconds, n_rhs, solution.t, solution.u, solution.v, drift, True, method)
        return self.judged(solution.n_steps, history)

    def judged(self, n_steps: int, history: PilotStates) -> PilotRun:
        """The run of this history, with its error extrapolated to the whole span."""
        error, power, right = self._error(history)
        growth = (1 / self.part) ** max(power, self.least_power) if self._growth is None else self._growth
        return PilotRun(n_steps, error * growth, history.seconds / n_steps, history.n_rhs / n_steps, error, right)

    @property
    def sizes(self) -> tuple[float, float] | None:
        """The sizes of u and v if the motion starts from rest, and they are unknown at the start; otherwise None."""
        u, v = self._sizes.tolist()
        if np.any(self._motion(self.at_start[1])) or u <= 0:
            return None
        return (u, v) if self._first_acceleration < _REST * v * v / u else None

    @property
    def h_max(self) -> float | None:
        """The longest step of a motion from rest: the time between the compared states of the whole span."""
        return None if self.sizes is None else self.span / self._states

    def time_of_a_step(self, method: Method, total: int, pace: float) -> float:
        """Seconds, measured in a short run with the step of `total` steps over the span; `pace` is an estimate."""
        count = max(1, min(total, int(_LONGEST_TIMED / pace)))
        history = self._advance(method, self.span / total, count, save_every(self.problem, total))
        return history.seconds / count if history else pace

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

    def _advance(
        self, method: Method, h: float, n_steps: int, every: int, longest: float = math.inf, *, follow: bool = False
    ) -> PilotStates | None:
        """Run in pieces, and stop once the run has diverged or taken `longest` seconds of processor time.

        A run with more occurrences of events than steps counts as unstable: a motion that changes stiffness or bounces
        stays bounded, and an unstable one then passes the same events in each step. A run in which a point may pass
        through another in a step counts as unstable too.

        Each `every`-th state is kept. With `follow`, the energy is computed, and the last state of each piece is kept.
        """
        stepper = self._stepper(method, h)
        if math.isnan(self._first_acceleration):
            self._first_acceleration = float(np.abs(self._motion(stepper.first_acceleration)).max())
        states = n_steps // every
        fewest = 1 if follow else math.ceil(_PIECE / every)
        most = max(fewest, math.ceil(states / _PIECES))
        each = math.ceil(_FIRST_PIECE / every) if self._events else most
        if self._paces.get(method, 0.0) > _SLOW_STEP:
            each = 1
        shape = most if follow else states, *np.shape(self._u0)
        u, v = np.empty(shape), np.empty(shape)
        ends: list[tuple[float, Any, Any]] = []
        decayed, drift, begin = False, 0.0, time.thread_time()
        while stepper.index < n_steps and time.thread_time() - begin < longest:
            first = stepper.index // every
            each = max(1, min(each, int(_LONGEST_PIECE / self._paces.get(method, 1e-12) / every)))
            count = min(each * every, n_steps - stepper.index)
            rows = slice(0, count // every) if follow else slice(first, first + count // every)
            taken = stepper.advance(count, every, u[rows], v[rows])
            is_unstable = stepper.look is not None and stepper.look.n_found > stepper.index
            if taken < count or is_unstable or not stepper.is_finite or stepper.sizes[0] > self._largest:
                return None
            self._paces[method], each = (time.thread_time() - begin) / stepper.index, min(2 * each, most)
            if h_without_jumps(stepper) < h:
                self.have_jumps = True
                return None
            if follow:
                drift = max(drift, self._drift(first + 1, h * every, u[rows], v[rows]))
                ends.append((stepper.t, stepper.u, stepper.v))
            elif 0 < max(stepper.sizes) < _AT_REST:  # a step with subnormal numbers takes a hundred times as long
                u[rows.stop :] = v[rows.stop :] = 0.0
                decayed = True
                break
        whole = n_steps / stepper.index
        if follow:
            t, u, v = (np.array(x) for x in zip(*ends, strict=True))
        else:
            seen = states if decayed else stepper.index // every
            t = self.window[0] + h * every * np.arange(1, seen + 1)
            u, v = u[:seen], v[:seen]
        is_whole = decayed or stepper.index == n_steps
        if not is_whole:
            self._paces.pop(method, None)  # points that penetrate each other make steps slow
        return PilotStates(stepper.seconds * whole, stepper.n_rhs * whole, t, u, v, drift, is_whole, method, h)

    @property
    def size(self) -> float:
        """The displacement that scales the errors; infinite if it is unknown, and NaN if nothing has moved."""
        u, v = self._sizes
        if u < 0:
            return math.inf
        u = max(u, np.abs(self._moving(self._u0)).max(initial=0.0))
        return float(u) if v * self.span > _STILL * u else math.nan

    def _stepper(self, method: Method, h: float, start: tuple[float, Any, Any] | None = None) -> Stepper:
        """Return a stepper at the start, or at another time, u and v, with the events that change the motion."""
        t0, u0, v0 = start or (self.window[0], self._u0, self._v0)
        options: dict[str, Any] = {"h": h, "t0": t0, "params": self.problem.params, "method": method}
        if not self._events:
            return Stepper(self.problem.rhs, u0, v0, **options)
        u, v, form = check_state(u0, v0)
        system = System(self.problem.rhs, form, RunOptions(h=h, method=method, events=self._events))
        return Stepper.of(system, t0, h, u, v, guarded(check_params(self.problem.params)))

    def unevenness(self, h: float) -> float:
        """How many times more steps of equal length than of equal error the reference method takes, about.

        `h` is doubled until the error of a single step is above round-off.
        """
        errors = self._errors_of_single_steps(h)
        while np.median(errors) < _ABOVE_ROUND_OFF and 2 * h < self.part * self.span:
            h *= 2
            errors = self._errors_of_single_steps(h)
        assert self._seen is not None
        order = self._seen.method.order
        return float(np.mean(errors) ** (1 / order) / np.mean(errors ** (1 / (order + 1))) ** (1 + 1 / order))

    def _errors_of_single_steps(self, h: float) -> np.ndarray:
        """Return the differences of one step from two steps of half the length, at states of the last known run."""
        seen = self._seen
        assert seen is not None
        errors = []
        for row in np.linspace(0, len(seen.t), _COMPARED, endpoint=False).astype(int):
            start = float(seen.t[row]), seen.u[row], seen.v[row]
            one, two = (self._stepper(seen.method, h / count, start) for count in (1, 2))
            one.advance(1)
            two.advance(2)
            changes = np.array([np.abs(self._motion(a - b)).max() for a, b in ((one.u, two.u), (one.v, two.v))])
            error = float((changes / self._sizes).max())
            errors.append(error if math.isfinite(error) else 1.0)
        return np.clip(errors, 1e-16, 1.0)

    def _solve(
        self, method: Method, rtol: float, most: int, *, follow: bool = False, every: int | None = None
    ) -> Solution:
        """Run with tolerances over the part of the span; with `follow`, keep the data for the error."""
        if follow and self.needs_reference:
            every = math.ceil(most * np.size(self._u0) / _FOLLOWED)
        options: dict[str, Any] = {"save_every": every, "events": self._events}
        options |= tolerances(rtol, self.sizes, self.h_max)
        if follow and self._energy:
            options["invariants_every"] = 1
        else:
            options["invariants"] = {}
        problem = self.problem
        start: dict[str, Any] = {"u0": self._motion(self._u0), "v0": self._motion(self._v0)}
        if problem.unknowns.is_read:
            start["z0"] = problem.unknowns.separated(self._u0, self._v0)[2]
        window = problem.with_(**start, t_span=self.window)
        return window.integrate(method=method, max_steps=most, **options)

    def _motion(self, x: Any) -> Any:
        """Return u or v without first-order unknowns."""
        return x[..., : np.size(self.problem.u0)] if self.problem.z0 else x

    def _moving(self, x: Any) -> Any:
        """Return u or v of what moves."""
        return np.atleast_1d(self._motion(x))[..., self._moves]

    def _sizes_of(self, history: PilotStates) -> np.ndarray:
        return np.array([np.abs(self._moving(x)).max(initial=0.0) for x in (history.u, history.v)])

    def _compile(self, method: Method, argument: str, run: Callable[[], Any]) -> None:
        """Compile the kernels of a method by a first run, whose time does not count."""
        if (method, argument) not in self._compiled:
            self._compiled.add((method, argument))
            begin, busy = time.perf_counter(), time.thread_time()
            run()
            self.compiling += time.perf_counter() - begin
            self._begin += time.thread_time() - busy

    @property
    def _start_energy(self) -> float:
        problem = self.problem
        return float(problem.energy_of(problem.u0, problem.v0, z=problem.z0 if problem.unknowns.is_read else None))

    def _drift(self, first: int, spacing: float, u: np.ndarray, v: np.ndarray) -> float:
        """The largest relative change of the energy over states with this spacing."""
        assert self._energy is not None
        t0, params = self.window[0], guarded(check_params(self.problem.params))
        start = self._energy.call(t0, self._u0, self._v0, params)
        t = t0 + spacing * np.arange(first, first + len(u))
        changes = np.abs(energies(self._energy, params, t, u, v) - start)
        return float(changes.max(initial=0.0)) / abs(self._start_energy)

    def _error(self, history: PilotStates) -> tuple[float, float, float]:
        """The error within the window, the exponent of its growth with time, and `PilotRun.right`."""
        if not self.needs_reference:
            return history.drift, 1.0, math.inf
        assert self._reference is not None
        if math.isnan(history.h):
            t, u, known = self._at_some_steps(history)
        else:
            both = math.gcd(len(history.u), len(self._reference.u))
            t, u, known = (x[len(x) // both - 1 :: len(x) // both] for x in (history.t, history.u, self._reference.u))
        errors = np.abs(self._moving(u) - self._moving(known)).reshape(len(t), -1).max(axis=1, initial=0.0) / self.size
        error, half = float(errors.max()), float(errors[t <= sum(self.window) / 2].max(initial=0.0))
        right = np.append(self.window[0], t)[np.flatnonzero(errors > CONVERGING)]  # the state before each wrong one
        power = min(2.0, max(0.0, math.log2(error / half))) if half > 0 else 1.0
        return error, power, float((right.min(initial=math.inf) - self.window[0]) / (self.part * self.span))

    def _at_some_steps(self, history: PilotStates) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return times of a run with tolerances, its displacements, and the reference at these times.

        Dense output would compile more kernels; the reference method takes some more steps instead.
        """
        rows = np.unique(np.linspace(0, len(history.t) - 1, _COMPARED + 1).astype(int)[1:])
        known = [self._reference_at(float(t)) for t in history.t[rows]]
        return history.t[rows], history.u[rows], np.array(known)

    def _reference_at(self, t: float) -> Any:
        """Return the displacement of the reference at any time in the window."""
        reference = self._reference
        assert reference is not None
        if self.problem.exact and self.window[0] == self.problem.t_span[0]:
            return self.problem.exact(np.array([t]))[0][0]
        row = int(np.searchsorted(reference.t, t, side="right")) - 1
        start = self.window[0], self._u0, self._v0
        if row >= 0:
            start = float(reference.t[row]), reference.u[row], reference.v[row]
        count = math.ceil((t - start[0]) / reference.h)
        if count == 0:
            return start[1]
        stepper = self._stepper(reference.method, (t - start[0]) / count, start)
        stepper.advance(count)
        return stepper.u


def save_every(problem: Problem, n_steps: int) -> int:
    """The `save_every` for about 2000 saved states, or fewer for a large system."""
    most = min(2048, max(64, _VALUES // np.size(problem.u0)))
    return 2 ** max(0, (n_steps // most).bit_length() - 1)


def tolerances(rtol: float, sizes: tuple[float, float] | None, h_max: float | None) -> dict[str, Any]:
    """The arguments of `Problem.integrate` for errors relative to the sizes of u and v, or to the sizes so far."""
    if sizes is None:
        return {"rtol": rtol}
    return {"rtol": rtol, "atol": rtol * np.array(sizes)[:, None], "h_max": h_max}
