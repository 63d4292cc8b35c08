"""Run to an accuracy: estimate the error of a run, and repeat it with shorter steps until it is small enough."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from ..diagnosis.coarseness import h_without_jumps
from ..functions.checks import check_cancel, check_method, check_span, reals, shown
from ..functions.companions import history_of, remembered
from ..functions.layout import unknown_name
from ..kernels.compile.interrupt import keeping
from ..methods import RK5, RK8, RKN12
from ..result.error_estimate import ErrorEstimate, written
from ..result.solution import Solution, Status
from ..stepping.march import Cancel
from ..stepping.run_options import RunOptions
from ..stepping.tolerances import LEAST_RTOL
from .chunks import IntegrationError, check_repeatable
from .prepare import Prepared
from .variable_run import RATIO

AIM = 0.5  # the next run aims at this fraction of the accuracy
_FIRST_RTOL = 0.003  # of the accuracy; the error of a whole run is larger than the error of a step
_LARGEST_RTOL = 1e-2
_FAR_BELOW = 0.1  # with a smaller error, relative to the accuracy, later calls begin with a larger tolerance,
_LARGER = 100.0  # by at most this factor
_STEPS = 1000  # of the first run of a method with a fixed step
_MANY = 1e7  # most steps of a run in which no point passes through another
LEAST = RATIO * LEAST_RTOL  # a run with a smaller tolerance has no finer run
MOST_RUNS = 12
LEAST_GAIN = 0.7  # a refined run whose error is a larger fraction of the best error does not converge,
MOST_STALLED = 2  # and after this number of such runs the search ends
LARGEST_CHANGE = 1e-4  # least factor from one step, or tolerance, to the next
_WITH_ERROR = 3.0  # times of the kernel for a run with a fixed step and its error, at most
_SHORTEN = 0.25  # factor to a step that was unstable, or after which no digit was right at the end
RESOLVED = 100  # with fewer steps before the time from which no digit is right, the step is too long to show chaos
_INTERRUPTED = "The run reached the end of its span, but was interrupted before its error was known."
WITH_TOLERANCES = RK5, RK8, RKN12  # other methods take a fixed step


class Known(NamedTuple):
    """What a run that reached an accuracy has shown: the h or rtol for the next run, and its `ErrorEstimate.coarser`.

    The latter is None if it is not sure in the first call: in one of many calls, it may be right by chance.
    """

    value: float
    coarser: float | None


class Goal(NamedTuple):
    """The accuracy of a run.

    Attributes
    ----------
    wanted : dict of str to float
        The largest error of each quantity: "u", "v", "drift", or the name of an output, of an event or in z0.
    scale : float or None
        The size to which the errors are relative; None for the largest size of each quantity.
    max_seconds : float
    """

    wanted: Mapping[str, float]
    scale: float | None
    max_seconds: float

    def miss(self, solution: Solution) -> float:
        """Return the largest error of a run as a multiple of the wanted error; infinity if an error is not known."""
        return float(max(self.misses(solution).values()))

    def misses(self, solution: Any) -> dict[str, Any]:
        """Return each error, of a run or of each member, as a multiple of the wanted error; infinity if not known."""
        zero, found = np.zeros(solution.t.shape[:-1]), {}
        # the errors of members take time, and drifts do not need them
        errors: Any = {} if self.wanted.keys() == {"drift"} else solution.error.largest
        for name, wanted in self.wanted.items():
            error = errors.get(name, np.nan + zero)
            if name == "drift":
                each = [zero]
                for invariant, drift in solution.drift.items():
                    extremes = solution.extremes[invariant]
                    each.append(drift / self._size(solution, np.stack([extremes.low, extremes.high], axis=-1)))
                error = np.max(each, axis=0)
            elif name in solution.events:
                span = np.nanmax(solution.t, axis=-1) - solution.t[..., 0]
                error = error / (self.scale or span)
            else:
                error = error / self._size(solution, _values_of(solution, name))
            found[name] = np.where(np.isnan(error), np.inf, error / wanted)[()]
        return found

    def _size(self, solution: Any, values: np.ndarray) -> Any:
        """Return the size to which errors are relative, of a run or of each member, whose values these are."""
        axes = tuple(range(solution.t.ndim - 1, values.ndim))
        largest = np.fmax.reduce(np.abs(values), axis=axes, initial=0.0)
        return self.scale or np.where(largest > 0, largest, 1.0)


def _values_of(solution: Any, name: str) -> np.ndarray:
    """Return the saved values of a quantity, with zeros in u for what only events change."""
    if name == "u":
        return np.where(np.expand_dims(written(solution), solution.t.ndim - 1), 0.0, solution.u)
    return solution.v if name == "v" else np.asarray((solution.outputs | solution.z).get(name, 1.0))


class Deadline:
    """A `cancel` for all runs to an accuracy, which is also set after `Goal.max_seconds`.

    The time begins when a run first asks whether it is set: then the run has compiled its code.
    """

    def __init__(self, goal: Goal, cancel: Cancel | None) -> None:
        self._seconds, self._cancel, self._begin = goal.max_seconds, check_cancel(cancel), math.inf

    def is_set(self) -> bool:
        self._begin = min(self._begin, perf_counter())
        return self.has_passed or (self._cancel is not None and self._cancel.is_set())

    @property
    def of_runs(self) -> Cancel | None:
        """The `cancel` to give to the runs. Without `max_seconds`, it is what the user gave."""
        return self if self._seconds < math.inf else self._cancel

    @property
    def spent(self) -> float:
        return max(0.0, perf_counter() - self._begin)

    @property
    def has_passed(self) -> bool:
        return self.spent > self._seconds

    def share(self, seconds: float) -> float:
        """Return these seconds as a fraction of half the time that is left: a run may take twice what is expected."""
        left = (self._seconds - self.spent) / 2
        return seconds / left if left > 0 else math.inf

    def reason(self, seconds: float) -> str:
        """Return the reason why a run of this time cannot follow; an empty text if it can."""
        return (
            f"the next run would exceed max_seconds = {self._seconds:g}" if self.spent + seconds > self._seconds else ""
        )

    def explain(self, message: str) -> str:
        """Return the message of an interrupted run, with the reason if the time has passed."""
        return f"{message[:-1]}: max_seconds = {self._seconds:g} had passed." if self.has_passed else message


def check_goal(accuracy: Any, scale: Any, max_seconds: Any) -> Goal:
    """Check the arguments of a run to an accuracy.

    Raises
    ------
    TypeError, ValueError
        If an accuracy is not between 0 and 1 (or positive, with a scale), or a name is not a text.
    """
    given = dict(accuracy) if isinstance(accuracy, Mapping) else {"u": accuracy}
    limit = 1.0 if scale is None else math.inf
    for name, value in given.items():
        number = reals(value, "accuracy")
        if not isinstance(name, str) or number.ndim or not 0 < number < limit:
            raise ValueError(
                f"accuracy must be a relative error between 0 and 1, or such errors by name, not {shown(accuracy)}."
            )
    if not given:
        raise ValueError("accuracy must name at least one error, such as {'u': 1e-6}.")
    for name, value in (("scale", scale), ("max_seconds", max_seconds)):
        if value is not None and not (np.ndim(value) == 0 and np.isreal(value) and 0 < value < math.inf):
            raise ValueError(f"{name} must be a positive number, not {shown(value)}.")
    wanted = {name: float(value) for name, value in given.items()}
    seconds = math.inf if max_seconds is None else float(max_seconds)
    return Goal(wanted, None if scale is None else float(scale), seconds)


def refuse_without_accuracy(**given: Any) -> None:
    """Refuse arguments that belong to an accuracy."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} belongs to accuracy: give accuracy too, or leave out {name}.")


def refuse_steps(**options: Any) -> None:
    """Refuse options that fix the step."""
    for name in ("h", "rtol", "atol", "first_step", "max_steps"):
        if options.get(name) is not None:
            raise ValueError(f"accuracy and {name} exclude each other: accuracy chooses the step.")


def reach(
    goal: Goal,
    rhs: Any,
    prepare: Callable[..., Prepared],
    options: dict[str, Any],
    start: tuple,
    of_call: dict[str, Any],
    longest: float,
) -> Solution:
    """Return the first run that reaches an accuracy, or the best run with the status ACCURACY_NOT_REACHED.

    After `cancel`, or if the first run takes more than `max_seconds`, the last run has the status INTERRUPTED.

    ``prepare(**options)`` returns a prepared run, which is called with `start` and the options `of_call`. No fixed step
    is longer than `longest`: a longer one jumps over a load, and the estimated error would not have it.

    Raises
    ------
    ValueError
        If an option fixes the step, the run writes files, or the accuracy has a name that is not known.
    """
    refuse_steps(**options)
    if of_call.get("save_to") is not None:
        raise ValueError("accuracy and save_to exclude each other: several runs may be needed; save the solution.")
    method = None if options.get("method") is None else check_method(options["method"])
    adapts = (method is None or isinstance(method, WITH_TOLERANCES)) and history_of(rhs) is None
    knob = "rtol" if adapts else "h"  # a history is of first order in the step, which tolerances do not see
    raises, key = bool(of_call.get("raise_on_failure")), (method, *sorted(goal.wanted.items()), goal.scale)
    deadline = Deadline(goal, of_call.get("cancel"))
    cancel = deadline.of_runs
    first = of_call | {"check": False, "raise_on_failure": False, "cancel": cancel}
    known, search = remembered(rhs, "accuracies"), _Search(goal, knob, deadline)
    value, coarser = known.get(key) or (search.first(start[0]), search.coarser)
    value = min(value, longest) if knob == "h" else value
    while True:
        prepared = prepare(**{**options, knob: value})
        check_accuracy_names(goal, prepared.options)
        check_repeatable(prepared.method)
        try:
            solution = prepared(*start, **first)
            if solution.success and _error(goal, solution, cancel, coarser) is None:
                solution.status, solution.message = Status.INTERRUPTED, _INTERRUPTED
        except MemoryError as error:
            if not search.runs:
                raise
            search.reason = f"with {knob} = {value:.3g} {str(error).rstrip('.')}"
            break
        following = search.after(solution, value)
        if following is None:
            break
        value, coarser = following, search.coarser
    if search.reached:
        known[key] = known[key]._replace(value=value) if key in known else _to_remember(goal, solution, value)
        return solution
    is_late = solution.status is Status.INTERRUPTED and deadline.has_passed
    if search.runs and (is_late or solution.status is not Status.INTERRUPTED):
        solution = search.best()
    elif is_late:
        solution.message = deadline.explain(solution.message)
    if raises:
        raise IntegrationError(solution)
    return solution


def _error(goal: Goal, solution: Solution, cancel: Any, coarser: float | None) -> ErrorEstimate | None:
    """Let a run have its error, by one further run if it is known by how much the error of a coarser run is larger.

    A finer run gives the error of a run with tolerances also where this ratio is not as expected. With a fixed step the
    further run is a coarser one: it must show the ratio, and that the accuracy is reached.
    """
    if coarser and solution._extend is not None:
        with keeping(solution):
            error = solution.error = solution._extend().error(solution, cancel, coarser)
        if error is None or solution.steps is not None:
            return error
        if goal.miss(solution) <= 1 and not error.notes:
            return error
    return solution.check(cancel=cancel)


def _to_remember(goal: Goal, solution: Solution, value: float) -> Known:
    """Return what later calls begin with: a larger tolerance, if the first call has found a far smaller error."""
    error = solution.error
    assert error
    if solution.steps is None:
        return Known(value, None if error.notes else error.coarser)
    if 0 < (miss := goal.miss(solution)) < _FAR_BELOW:
        value = min(_LARGEST_RTOL, min(_LARGER, AIM / miss) * value)
    return Known(value, RATIO)


def first_rtol(goal: Goal) -> float:
    """Return the tolerance of the first run."""
    return max(LEAST, min(_LARGEST_RTOL, _FIRST_RTOL * min(goal.wanted.values())))


def check_accuracy_names(goal: Goal, options: RunOptions) -> None:
    """Refuse names of quantities whose error the run does not have."""
    at_states = {*options.functions.outputs, *options.first_order.names}
    known = {"u", "v", "drift", *at_states, *options.events}
    for name in goal.wanted:
        if name not in known:
            raise unknown_name("accuracy has", name, sorted(known), ValueError)


class _Search:
    """The search for the step, or the tolerance, that reaches an accuracy."""

    def __init__(self, goal: Goal, knob: str, deadline: Deadline) -> None:
        self.goal, self.knob, self._deadline = goal, knob, deadline
        self.coarser = RATIO if knob == "rtol" else None  # a tolerance and the error of a run are about in proportion
        self._is_of_drift = goal.wanted.keys() == {"drift"}  # which may converge in chaos too
        self.runs: list[tuple[float, Solution]] = []  # each error as a multiple of the wanted error, and the run
        self.reached, self.reason = False, f"{MOST_RUNS} runs were not enough"
        self._count, self._stalled, self._before = 0, 0, 0.0
        self._right: tuple[float, float] | None = None  # the step of the run before, and how long its digits are right

    def first(self, span: Any) -> float:
        """Return the step, or the tolerance, of the first run."""
        if self.knob == "h":
            t0, t1 = check_span(span)
            return (t1 - t0) / _STEPS
        return first_rtol(self.goal)

    def after(self, solution: Solution, value: float) -> float | None:
        """Return the step, or the tolerance, of the next run; None if there is none."""
        now, self._count = self._deadline.spent, self._count + 1
        seconds, self._before = now - self._before, now
        if not solution.success:
            if self.knob == "h" and solution.status is Status.DIVERGED:
                if self._may_run(seconds / _SHORTEN):
                    return value * _SHORTEN
                if self._count < MOST_RUNS:
                    solution.message += f" A shorter step was not tried, because {self.reason}."
            else:
                self.reason = self._deadline.reason(0.0) or f"the next run had the status {solution.status.value}"
            return None
        miss = self.goal.miss(solution)
        is_lost = self.knob == "h" and solution.reliable_until is not None
        if miss <= 1:
            run = solution._extend() if self.knob == "h" and solution._extend else None
            shorter = h_without_jumps(run.stepper) / solution.h if run else 1.0
            self.reached = shorter == 1
            self.runs.append((miss if self.reached else math.inf, solution))
            may_run = self.reached or self._may_run(self._seconds(solution, seconds) / shorter)
            late = "" if may_run else f", and {self.reason}"
            self.reason = f"a point may pass through another in a step of more than {shorter * value:.2g}{late}"
            may_run = may_run and not self.reached and solution.n_steps <= shorter * _MANY
            return shorter * value if may_run else None
        if is_lost and not self._is_of_drift:
            self._stalled = self._stalls_in_chaos(solution, value)
        else:
            self._stalled += any(miss > LEAST_GAIN * each for each, _ in self.runs)
        self.runs.append((miss, solution))
        least = LEAST if self.knob == "rtol" else 0.0
        if self._stalled >= MOST_STALLED or value <= least:
            self.reason = ""
            return None
        order = 1.0 if self.knob == "rtol" else max(1.0, solution.order or solution.method.order)
        factor = min(0.5, max(_SHORTEN if is_lost else LARGEST_CHANGE, (AIM / miss) ** (1 / order)))
        if self.knob == "h":
            seconds = self._seconds(solution, seconds)
            factor = min(0.5, max(factor, self._deadline.share(seconds)))  # the shortest step that the time allows
            seconds /= factor
        return max(least, value * factor) if self._may_run(seconds) else None

    def _seconds(self, solution: Solution, seconds: float) -> float:
        """Return the seconds that grow with the steps: those outside the kernel do not."""
        return min(seconds, _WITH_ERROR * solution.kernel_seconds)

    def _stalls_in_chaos(self, solution: Solution, value: float) -> int:
        """Return the number of runs up to this run that show that shorter steps hardly help.

        If no digit is right at the end, the errors are as large as the motion, and the times up to which digits are
        right are compared. In a regular motion, an error grows at most with the square of time, and these times at
        least like h^(-order / 2). In chaos they grow like the logarithm of 1 / h.
        """
        assert solution.reliable_until is not None
        before, right = self._right, float(solution.reliable_until - solution.t[0])
        self._right = (value, right) if right >= RESOLVED * value else None
        if not before or not self._right:
            return self._stalled
        if right <= before[1]:  # while the step is too long, or a little by round-off after a sign of chaos
            return self._stalled + (self._stalled > 0 and right > before[1] / 2)
        power = math.log(right / before[1]) / math.log(before[0] / value)
        return self._stalled + 1 if power < solution.method.order / 4 else 0

    def _may_run(self, seconds: float) -> bool:
        """Whether there may be a further run of this time."""
        late = self._deadline.reason(seconds)
        self.reason = late or self.reason
        return not late and self._count < MOST_RUNS

    def best(self) -> Solution:
        """Return the run with the smallest error, with the reason why the accuracy is not reached.

        In chaos, the errors are as large as the motion: then it is the run whose digits are right for the longest time.
        """
        _, solution = min(self.runs, key=lambda run: (0.0 if self._is_of_drift else -_right_until(run[1]), run[0]))
        misses = self.goal.misses(solution)
        name = max(misses, key=lambda each: misses[each])
        wanted, reason = self.goal.wanted[name], self.reason or why(None if self._is_of_drift else solution.error)
        solution.status = Status.ACCURACY_NOT_REACHED
        solution.message = (
            f"The accuracy {wanted:g} of {name} is not reached, because {reason}: the estimated error is "
            f"{misses[name] * wanted:.2g}."
        )
        return solution


def _right_until(solution: Solution) -> float:
    return math.inf if solution.reliable_until is None else solution.reliable_until


def why(error: Any) -> str:
    """Return the reason why a shorter step does not help, from the estimated errors; None for the drift alone."""
    if error and error.reliable_until is not None:
        since = f"after t = {error.reliable_until:.4g}" if error.reliable_until > error.t[0] else "at the end"
        return f"no digit of u is right {since}, as in a chaotic motion"
    return "round-off, or kinks of the motion, limit the error"
