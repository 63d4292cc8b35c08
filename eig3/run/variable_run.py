"""A run with tolerances: a Python loop calls the kernel for one chunk of steps after the other."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..functions.checks import check_count, check_time, reals
from ..functions.quantities import Functions, Quantity, as_extremes
from ..functions.samples import Samples
from ..kernels.loops.dense import COEFFICIENTS
from ..kernels.loops.events import NOT_A_NUMBER, NOT_FINITE, RESTING, TERMINAL, ZENO
from ..kernels.loops.variable import AT_END, BEFORE_END, FULL, GOING, TOO_SMALL
from ..result.growing import GrowingHistory, Rows
from ..result.solution import Solution, Status
from ..result.storage import Place, going_on, whole_rows
from ..stepping.tolerances import Tolerances
from ..stepping.variable_stepper import VariableStepper
from ..stepping.watching import ended_by_event, not_a_number
from .progress import Progress, check_progress

_CHUNK_SECONDS = 0.02  # duration of a chunk of steps, after which its states are seen
_FIRST_STEPS = 64  # steps of the first chunk, if nothing is known about the time of a step
_GROWTH = 8  # largest factor from the steps of one chunk to the steps of the next
_NAMED = 5  # degrees of freedom that a note names
_CHUNK_VALUES = 2**16  # values in the rows of a chunk, so that they stay in the cache
_DENSE_VALUES = 2**17  # values in the dense output of the steps of one call, if something is followed


class Stop(Protocol):
    """An object that says whether to end a run, or a chunk of its steps."""

    def is_final(self) -> bool:
        """Return True to end the run."""
        ...

    def begin_chunk(self) -> None:
        """Begin a chunk of steps."""
        ...

    def is_set(self) -> bool:
        """Return True to end the chunk."""
        ...


class Followed:
    """An invariant or an output along a run with tolerances."""

    _floor = 0.0  # a smaller relative change within a step, as a multiple of rtol, is not looked at

    def __init__(self, quantity: Quantity, stepper: VariableStepper) -> None:
        self.quantity, self._params = quantity, stepper.params
        self._extremes = quantity.no_extremes()
        self._start = quantity.at_start(stepper.t, stepper.u, stepper.v, self._params, self._extremes)
        floor = self._floor * stepper.tolerances.rtol
        self._samples = Samples.of(np.atleast_1d(self._start), stepper.n, stepper.order, floor)

    def see(self, rows: Rows, dense: np.ndarray) -> None:
        """Evaluate the function in every state of a chunk, and within the steps that led there."""
        self._note(self.quantity.evaluate_within(rows, dense, self._samples, self._params, self._extremes))

    def widen(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
        """Evaluate the function before and after events."""
        self._note(self.quantity.evaluate(t, u, v, self._params, self._extremes))

    def _note(self, values: np.ndarray) -> None:
        """Take note of values at the ends of steps and at events."""

    @property
    def extremes(self) -> Any:
        return as_extremes(self._extremes, self.quantity.shape)

    def values(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the values in the saved states."""
        return self.quantity.evaluate(t, u, v, self._params, self.quantity.no_extremes()).copy()

    def values_before_error(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the values in the saved states up to the first in which the function raises an exception, then NaN."""
        values = np.full((len(t), *self.quantity.shape), np.nan)
        with contextlib.suppress(Exception):
            for i in range(len(t)):
                values[i] = self.values(t[i : i + 1], u[i : i + 1], v[i : i + 1])[0]
        return values

    def kept(self) -> dict[str, Any]:
        """Return what this object needs to go on, in numbers and arrays."""
        return {"extremes": self._extremes.copy(), "before": self._samples.before.copy()}

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Become the object that has returned `kept`."""
        np.copyto(self._extremes, kept["extremes"])
        np.copyto(self._samples.before, kept["before"])

    def copy(self) -> Any:
        other = object.__new__(type(self))
        vars(other).update(vars(self), _extremes=self._extremes.copy(), _samples=self._samples.copy())
        return other


class FollowedInvariant(Followed):
    """An invariant along a run with tolerances.

    Attributes
    ----------
    drift : float
        The maximum of |e_n - e_0| over the steps so far; NaN if e became NaN. The dense output within the steps has no
        part in it: its error does not add up, and would hide the drift of an accurate method.
    """

    drift = 0.0
    _floor = 1.0  # an invariant that is nearly constant takes few evaluations

    def _note(self, values: np.ndarray) -> None:
        self.drift = float(np.max(np.abs(values - self._start), initial=self.drift))

    def kept(self) -> dict[str, Any]:
        return {**super().kept(), "drift": self.drift}

    def restore(self, kept: Mapping[str, Any]) -> None:
        super().restore(kept)
        self.drift = float(kept["drift"])


class _Mark(NamedTuple):
    """A point from which a run can go on: the end of its last step that does not follow from the end of the span."""

    stepper: VariableStepper
    rows: int
    invariants: dict[str, FollowedInvariant]
    outputs: dict[str, Followed]


def _followed(
    functions: Functions, stepper: VariableStepper
) -> tuple[dict[str, FollowedInvariant], dict[str, Followed]]:
    """Return the invariants and the outputs of a run at its start."""
    watched, shown = functions.quantities(stepper.form)
    invariants = {name: FollowedInvariant(quantity, stepper) for name, quantity in watched.items()}
    return invariants, {name: Followed(quantity, stepper) for name, quantity in shown.items()}


class VariableRun:
    """A run with tolerances, and its history.

    Parameters
    ----------
    mark : _Mark
        Where the run begins.
    every : int
        Every `every`-th state is saved; `NEVER` saves the first and the last.
    history : GrowingHistory
        With the states up to there.
    progress : bool
    place : Place or None
        Where the run saves its rows.
    """

    def __init__(
        self, mark: _Mark, every: int, history: GrowingHistory, progress: bool, place: Place | None = None
    ) -> None:
        self.stepper, _, self.invariants, self.outputs = mark
        self.every, self.history, self.place, self._shows_progress = every, history, place, progress
        self.status = Status.COMPLETED
        self.message = "The run reached the end of its span."
        pace = self.stepper.pace
        self._count = max(1, int(_CHUNK_SECONDS / pace)) if pace else _FIRST_STEPS
        self._is_done = False
        self._raised: tuple[int, Exception] | None = None
        self._n_found = self.stepper.watching.n_found
        self._dense = np.empty((0, COEFFICIENTS, self.stepper.n))
        self._mark: _Mark | None = None
        self._rows: Rows | None = None
        if place:
            try:
                self._write_outputs()
                place.keep(history.count, self._so_far)
            except BaseException:
                history.remove()
                raise

    @classmethod
    def begin(
        cls, stepper: VariableStepper, every: int, functions: Functions, progress: bool, place: Place | None
    ) -> VariableRun:
        """Return a run at its start."""
        followed = _followed(functions, stepper)
        history = GrowingHistory(stepper.form, stepper.n, functions.shapes, place.directory if place else None)
        history.append(stepper.present(0.0))
        return cls(_Mark(stepper, 1, *followed), every, history, progress, place)

    def extended(self, t_end: float, progress: bool, save_to: Any) -> VariableRun:
        """Return an independent run to a later end, with the numbers of one run over the whole span."""
        check_progress(progress)
        t_end = check_time(t_end, "t_end")
        saved = [] if self._rows is None else self._rows.t[-1:].tolist()
        end = max([self.stepper.t, *saved])  # after `restored`, the stepper may stand before the end
        if not t_end > end:
            raise ValueError(f"t_end must be after the end of the run at t = {end!r}, not {t_end!r}.")
        place = None if save_to is None else Place.of(save_to)
        mark = self._start_to(t_end) if self.stepper.follows_span else self._going_on(t_end)
        stepper = mark.stepper
        shapes = {name: output.quantity.shape for name, output in self.outputs.items()}
        history = GrowingHistory(stepper.form, stepper.n, shapes, place.directory if place else None)
        history.append((self._rows or self.history.rows()).at(slice(mark.rows)))
        return VariableRun(mark, self.every, history, progress, place)

    def _start_to(self, t_end: float) -> _Mark:
        """Return the start, for a run to another end."""
        stepper = self.stepper.restarted(t_end)
        invariants = {name: FollowedInvariant(each.quantity, stepper) for name, each in self.invariants.items()}
        outputs = {name: Followed(each.quantity, stepper) for name, each in self.outputs.items()}
        return _Mark(stepper, 1, invariants, outputs)

    def _going_on(self, t_end: float) -> _Mark:
        """Return a copy of the mark, for a run to a later end."""
        mark = self._mark or self._marked()
        groups = ({name: followed.copy() for name, followed in group.items()} for group in mark[2:])
        return _Mark(mark.stepper.extended(t_end), mark.rows, *groups)

    @classmethod
    def restored(cls, solution: Solution, rhs: Any, events: Any, functions: Functions) -> VariableRun:
        """Return the run of a loaded solution, which stands at its end; the names of its functions are right."""
        state = solution._state or {}
        with going_on():
            tolerances = Tolerances(**state["tolerances"])
        options = {name: state[name] for name in ("params", "inline")} | {"method": solution.method}
        span, start = (state["t0"], float(solution.t[-1])), state["start"]
        stepper = VariableStepper(rhs, span, *start, tolerances=tolerances, events=events, t_eval=None, **options)
        followed = _followed(functions, stepper)
        with going_on():
            if reals(tolerances.atol, "atol").shape != (2, stepper.n):
                raise ValueError("atol has another shape.")
            stepper.restore(state["stepper"])
            stepper.watching.recall(solution.events, state["events"])
            for group in followed:
                for name, each in group.items():
                    each.restore(state["followed"][name])
            t, u, v = whole_rows(solution, stepper.n)
            rows = Rows(t, np.asarray(solution.steps), u.reshape(len(t), -1), v.reshape(len(t), -1))
            mark = _Mark(stepper, check_count(state["rows"], "rows"), *followed)
            if mark.rows > len(t):
                raise ValueError(f"{len(t)} states are too few.")
        run = cls(mark, check_count(state["every"], "save_every"), GrowingHistory(stepper.form, stepper.n, {}), False)
        run._mark, run._rows = mark, rows
        return run

    def state(self) -> dict[str, Any] | None:
        """Return the state from which the run goes on, in numbers and arrays; None with `t_eval`."""
        if self.stepper.watching.times is not None:
            return None
        mark = self._mark or self._marked()
        stepper = mark.stepper
        return {
            "t0": stepper.t0,
            "start": stepper.start,
            "params": stepper.params,
            "inline": stepper.inline,
            "has_jacobian": False,
            "tolerances": vars(stepper.tolerances),
            "every": self.every,
            "rows": mark.rows,
            "stepper": stepper.kept(),
            "events": {name: len(found) for name, found in stepper.watching.occurrences().items()},
            "followed": {name: each.kept() for name, each in {**mark.invariants, **mark.outputs}.items()},
        }

    def march(self, stop: Stop) -> None:
        """Run to the end, or until the run fails or should stop."""
        stepper = self.stepper
        with Progress(100 - self._percent, "%", self._shows_progress) as bar:
            while not self._is_done:
                if stop.is_final():
                    self._end(Status.INTERRUPTED, f"The run was interrupted after t = {stepper.t:g}.")
                    break
                left = stepper.tolerances.max_steps - stepper.index
                if not left and stepper.t < stepper.t_end:
                    self._end(
                        Status.TOO_MANY_STEPS,
                        f"The run took max_steps = {stepper.index} steps up to t = {stepper.t:g}; take a larger "
                        "max_steps, or larger tolerances.",
                    )
                    break
                before = self._percent
                self._advance(min(self._count, max(1, left)), stop)
                bar.add(self._percent - before)
                self._judge()
                if self.place and not self._is_done:
                    self.place.keep(self.history.count, self._so_far)
        stepper.note_pace()

    def result(self, error: BaseException | None = None) -> Solution:
        """Return the run up to now; `error` is the exception that ended it, if there was one."""
        stepper = self.stepper
        if error and not self._is_done:
            what = f"raised {type(error).__name__}" if isinstance(error, Exception) else "was interrupted"
            self._end(Status.INTERRUPTED, f"The run {what} after t = {stepper.t:g}.")
        if self._rows is None:
            self._mark = self._mark or self._marked()  # before the last state, which a longer run may not save
            self._rows = self._saved(error)
        solution = self._solution(self._rows)
        self._describe(solution)
        rows = solution.t, solution.u, solution.v
        solution.outputs = self.history.outputs or {
            name: output.values_before_error(*rows) if error else output.values(*rows)
            for name, output in self.outputs.items()
        }
        solution._between = self.between
        return solution

    def _so_far(self) -> Solution:
        """Return a run that goes on; its rows are in files."""
        solution = self._solution(self.history.rows())
        solution.status = Status.INTERRUPTED
        self._describe(solution)
        solution.outputs, solution._resume = self.history.outputs, self.state
        return solution

    def _describe(self, solution: Solution) -> None:
        """Write what is followed, besides the rows, to a solution."""
        followed = {**self.invariants, **self.outputs}
        solution.drift = {name: invariant.drift for name, invariant in self.invariants.items()}
        solution.extremes = {name: quantity.extremes for name, quantity in followed.items()}
        solution.events, solution.notes = self.stepper.watching.occurrences(), tuple(self._notes())

    @property
    def between(self) -> Any:
        """The function of `Solution.at` for a run by RK8 whose states are all saved; None for other runs."""
        stepper = self.stepper
        has_all = stepper.method.variable == "rk8" and self.every == 1 and stepper.watching.times is None
        return stepper.states_between if has_all else None

    def _notes(self) -> Iterator[str]:
        tiny = self.stepper.tiny if self.stepper.n > 1 else ()
        if len(tiny):
            which = ", ".join(f"u[{j}]" for j in tiny[:_NAMED]) + (", ..." if len(tiny) > _NAMED else "")
            yield (
                f"The motion of {which} is so small beside the largest one that the error of a step may be a tenth of "
                "it or more. Give atol, or a smaller rtol, if it matters."
            )
        step, end = self.stepper.silence
        if step:
            yield (
                f"The acceleration was zero up to t = {end:.4g}, and rhs reads t: the steps were held short, but a "
                f"load that acts for less than {step:.2g} there may have been jumped over; h_max sets the longest step."
            )

    def _solution(self, rows: Rows) -> Solution:
        """Return a solution without what is followed."""
        stepper = self.stepper
        u, v = rows.in_form(stepper.form)
        return Solution(
            t=rows.t,
            u=u,
            v=v,
            h=(stepper.t - stepper.t0) / max(1, stepper.index),
            n_steps=stepper.index,
            n_rhs=stepper.n_rhs,
            n_iterations=0,
            status=self.status,
            message=self.message,
            kernel_seconds=stepper.seconds,
            method=stepper.method,
            n_rejected=stepper.n_rejected,
            steps=rows.h,
            _accelerations=stepper.accelerations,
        )

    def _advance(self, count: int, stop: Stop) -> None:
        """Take at most `count` steps. If rhs raises an exception, take the steps before it first.

        An exception that does not come again, when these steps are taken, came from the handler of a signal.
        """
        stepper = self.stepper
        followed = [*self.invariants.values(), *self.outputs.values()]
        every = 1 if followed else self.every
        is_kept = stepper.watching.times is None
        capacity = 0
        if followed:
            capacity = min(2 * (count + 2), max(4, _DENSE_VALUES // (COEFFICIENTS * stepper.n)))
        elif is_kept:
            capacity = min(2 * (count // every + 2), max(4, _CHUNK_VALUES // stepper.n))
        if followed and len(self._dense) < capacity:
            self._dense = np.empty((capacity, *self._dense.shape[1:]))
        first, begin = stepper.index, time.perf_counter()
        stop.begin_chunk()
        try:
            rows = stepper.advance(count, every, Rows.empty(capacity, stepper.n), self._dense, stop)
        except Exception as error:
            if count == 1 or stepper.raised_before is None:
                raise
            self._raised, self._count = (stepper.raised_before, error), count // 2
            return
        if is_kept:
            self.history.append(rows if every == self.every else self._chosen(rows, first))
        for each in followed:
            each.see(rows, self._dense[: len(rows.t)])
        if stepper.watching.n_found > self._n_found:
            for each in followed:
                each.widen(*stepper.watching.states_from(self._n_found))
            self._n_found = stepper.watching.n_found
        self._write_outputs()
        if self._raised and (stepper.index >= self._raised[0] or stepper.ended not in (GOING, FULL)):
            raise self._raised[1]
        spent, taken = time.perf_counter() - begin, stepper.index - first
        self._count = max(1, int(max(1, taken) * min(_GROWTH, _CHUNK_SECONDS / (spent + 1e-9))))

    def _write_outputs(self, error: BaseException | None = None) -> None:
        """Write the values of the outputs in the new states, if the states are in files."""
        self.history.write_outputs(
            {name: each.values_before_error if error else each.values for name, each in self.outputs.items()}
        )

    def _chosen(self, rows: Rows, first: int) -> Rows:
        """Return the rows to save from the rows of all steps after step index `first`.

        A reset gives two rows for one step, with the same time, of which the second is the state after it. A reset at
        the start of a step gives one row, with a step of length 0.
        """
        is_step_begun = np.append((rows.t[1:] != rows.t[:-1]) | (rows.h[1:] == 0), True)
        ends = np.flatnonzero(is_step_begun[: len(rows.t)])
        index = first + 1 + np.arange(len(ends))
        return rows.at(ends[index % self.every == 0])

    def _saved(self, error: BaseException | None) -> Rows:
        """Return the saved states. The last one is the present state, except with `t_eval`."""
        stepper, history = self.stepper, self.history
        rows = stepper.wanted_rows()
        if rows is not None:
            return rows
        last, present = history.last, stepper.present(stepper.h_before)
        if not all(np.array_equal(last[i], present[i]) for i in (0, 2, 3)):
            history.append(present)
        self._write_outputs(error)
        history.close()
        return history.rows()

    def _marked(self) -> _Mark:
        copies = ({name: f.copy() for name, f in group.items()} for group in (self.invariants, self.outputs))
        return _Mark(self.stepper.fork(), self.history.count, *copies)

    @property
    def _percent(self) -> int:
        stepper = self.stepper
        return round(100 * (stepper.t - stepper.t0) / (stepper.t_end - stepper.t0))

    def _end(self, status: Status, message: str) -> None:
        self.status, self.message, self._is_done = status, message, True

    def _judge(self) -> None:
        """Find out from the kernel's outcome whether the run goes on."""
        stepper = self.stepper
        ended, t = stepper.ended, stepper.t
        if ended == AT_END:
            self._is_done = True
        elif ended == BEFORE_END:
            self._mark = self._marked()
            stepper.shorten()
        elif ended in (TERMINAL, ZENO, RESTING):
            stepper.finish()
            self._end(*ended_by_event(stepper))
        elif ended in (NOT_A_NUMBER, NOT_FINITE):
            raise not_a_number(stepper, t)
        elif ended == TOO_SMALL:
            relative = "; if hardly anything has moved so far, rtol needs atol too"
            self._end(
                Status.STEP_TOO_SMALL,
                f"The tolerances need a step below the resolution of t at t = {t:g}: the motion may be singular there, "
                "rhs may jump or be NaN, or rtol and atol may be too small"
                f"{relative if stepper.tolerances.is_relative else ''}.",
            )
