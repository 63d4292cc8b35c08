"""The loop of a run, which calls the kernel in chunks, for fixed steps and for tolerances."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from ..diagnosis.drift import excess, growth
from ..diagnosis.half_turns import half_turns
from ..functions.checks import check_cancel, check_flag
from ..functions.companions import mark
from ..functions.evaluation import accelerations
from ..functions.events import Event
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.protocol import EVALUATIONS, ITERATIONS, NEXT, RESTING, TERMINAL, VECTOR
from ..methods import Method
from ..result.error_estimate import ErrorEstimate, losses, may_be_lost
from ..result.memory import check_error
from ..result.solution import Solution, Status
from ..result.storage import Place
from ..stepping.march import Cancel, Rows
from ..stepping.run_options import NEVER
from .progress import Progress
from .saved_rows import SavedRows

_CHUNK_SECONDS = 0.1  # duration of a chunk of steps, after which the run is checked
COMPLETED = "The run reached the end of its span."
_STATES, _VALUES = 1024, 2**22  # states of a run that shows up to when digits are right, and most values of u in them
_LEAST_STEPS = 100  # between two checks for entries of a that rhs does not write, to limit their cost
_FAST = 1e3  # a growth above this is not called slow
_MOST_JOINED = 2**27  # bytes of states in files that `extend` copies into memory
_OVERFLOW = "beyond the largest floating-point number,"


class IntegrationError(RuntimeError):
    """A run with ``raise_on_failure=True`` did not complete.

    Attributes
    ----------
    solution : Solution
        The computed part of the run.
    """

    def __init__(self, solution: Solution) -> None:
        super().__init__(solution.message)
        self.solution = solution

    def __reduce__(self) -> tuple:
        return type(self), (self.solution,)


class Stop:
    """Whether a chunk of steps should end: after Ctrl-C, after a cancellation, or after its usual duration."""

    def __init__(self, interrupt: DeferredInterrupt | None, cancel: Cancel | None) -> None:
        self._asked = [event for event in (interrupt, cancel) if event is not None]
        self._until = 0.0

    def is_final(self) -> bool:
        """Return whether the whole run should end."""
        return any(event.is_set() for event in self._asked)

    def begin_chunk(self) -> None:
        self._until = time.perf_counter() + _CHUNK_SECONDS

    def is_set(self) -> bool:
        return time.perf_counter() > self._until or self.is_final()


class Run:
    """A run in chunks of steps.

    Parameters
    ----------
    stepper : Stepper or VariableStepper
        Its state is the start of the run.
    every : int
        Every `every`-th state is saved; `NEVER` saves the first and the last.
    times : ndarray or None
        The times at which the state is saved instead.
    place : Place or None
        Where the run saves its rows.
    progress : bool
    history : SavedRows, optional
        For the rows; by default an empty history with space for them.

    Attributes
    ----------
    status : Status
    message : str
    reason : callable or None
        The function that `Solution.explain` calls.
    """

    def __init__(
        self,
        stepper: Any,
        every: int,
        times: np.ndarray | None,
        place: Place | None = None,
        progress: bool = False,
        history: SavedRows | None = None,
    ) -> None:
        self.stepper, self.every, self.times = stepper, every, times
        self.place, self._shows_progress = place, progress
        self.history = history or self._empty_history()
        self.status, self.message = Status.COMPLETED, COMPLETED
        self.reason: Callable[[], str] | None = None
        self.is_done = False
        self.saved: dict[str, np.ndarray] | None = None  # the rows, when the run has ended
        self.saved_outputs: dict[str, np.ndarray] = {}
        self._looked_at = stepper.index
        self._refer()

    # Differences between a fixed step and tolerances -----------------------------------------------------------------

    def extended(self, t_end: float, progress: bool, save_to: str | PathLike[str] | None, t_eval: Any) -> Run:
        """Return an independent run to a later end, which starts at the end of this run."""
        raise NotImplementedError

    def _empty_history(self) -> SavedRows:
        """Return an empty history with space for rows.

        Raises
        ------
        MemoryError, OSError
            If the history does not fit in memory, or on the disk of `save_to`.
        """
        raise NotImplementedError

    def error_of(self, solution: Solution, coarser: float | None, cancel: Cancel | None) -> ErrorEstimate:
        """Estimate the error of the solution of this run, by runs from its start with other steps.

        If it is known by how much the error of a coarser run is larger, one further run is enough. With a fixed step it
        is a coarser one. With tolerances it is a finer one: the factor differs much from one start to the next, and it
        hardly matters for the difference from a finer run.
        """
        raise NotImplementedError

    def with_states(self, count: int) -> Run:
        """Return the same run, which has not begun and will save about this number of states."""
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """Return the state from which the run continues, in numbers and arrays: what each kind of run has."""
        stepper = self.stepper
        return {
            "t0": stepper.t0,
            "start": stepper.start,
            "params": stepper.p,
            "layout": stepper.system.layout.text if stepper.system.layout else "",
            "inline": stepper.inline,
            "has_jacobian": stepper.method.jacobian is not None,
            "times": self.times,
        }

    def _left(self) -> int:
        """Return the number of steps to the end of the run, or to the next check."""
        raise NotImplementedError

    def _judge(self, first: int) -> None:
        """Find out whether the run continues, after the steps from step index `first` on."""
        raise NotImplementedError

    def _fields(self) -> dict[str, Any]:
        """Return fields of the solution that only this kind of run has."""
        raise NotImplementedError

    def _notes(self) -> list[str]:
        raise NotImplementedError

    @property
    def is_suspect(self) -> bool:
        """Whether the motion may have grown because of the step."""
        return False

    def judge_growth(self) -> None:
        """Change the status if the motion grew because of the step."""

    def _total(self) -> tuple[int, str]:
        """Return the length of the progress bar and its unit."""
        raise NotImplementedError

    def _progress(self) -> int:
        raise NotImplementedError

    # The loop ---------------------------------------------------------------------------------------------------------

    def march(self, stop: Stop) -> None:
        """Run to the end, or until the run fails or should stop."""
        if not self._shows_progress:
            self._march(stop, None)
        else:
            with Progress(*self._total()) as bar:
                self._march(stop, bar)
        self.stepper.note_pace()

    def _march(self, stop: Stop, bar: Progress | None) -> None:
        stepper, history = self.stepper, self.history
        most, growth = NEVER, 0
        raised: tuple[int, Exception] | None = None
        while not self.is_done:
            if stop.is_final():
                self._end(Status.INTERRUPTED, f"The run was interrupted after t = {stepper.t:g}.")
                return
            stop.begin_chunk()
            count, first, shown = min(most, self._left()), stepper.index, self._progress() if bar else 0
            if not count:
                return
            try:
                history.row = stepper.take(count, self.every, history.row, self._rows, (stop,))
            except Exception as error:
                if count == 1 or stepper.raised_before is None:
                    raise
                # Take all steps before the failing step: double the steps of a chunk, and halve them after a failure.
                raised = stepper.raised_before, error
                most, growth = (count // 2, 1) if growth else (1, 2)
                continue
            most *= growth or 1
            if self.times is not None:
                history.row = int(stepper.counters[NEXT])
            self._judge(first)
            stepper = self.stepper
            if stepper.look:
                stepper.look.check()
            if stepper.form is VECTOR and (stepper.index - self._looked_at >= _LEAST_STEPS or self.is_done):
                self._check_written()
            if bar:
                bar.add(self._progress() - shown)
            if self.place and not self.is_done:
                self._keep()
            has_passed = raised and (stepper.index >= raised[0] or self.is_done)
            if raised and has_passed and self.status is not Status.DIVERGED:
                raise raised[1]  # raised by the handler of a signal, not by a function

    def _check_written(self) -> None:
        """Refuse a rhs that does not write an entry of a.

        The entry would keep its value from an earlier evaluation, and the run would look correct. Filling a with NaN
        before each evaluation in the kernel would detect this, but costs time in each step. So rhs is evaluated again
        from time to time.
        """
        stepper = self.stepper
        self._looked_at, t = stepper.index, stepper.t - stepper.h
        j = stepper.find_unwritten(t)
        if j is not None:
            raise unwritten_entry(j, t)

    def _end(self, status: Status, message: str, reason: Callable[[], str] | None = None) -> None:
        self.status, self.message, self.reason, self.is_done = status, message, reason, True

    def _judge_event(self) -> bool:
        """End the run if an event ended it; return whether one did."""
        stepper = self.stepper
        if stepper.is_over:
            self._end(*ended_by_event(stepper.ended, stepper.ended_by, stepper.t))
        return stepper.is_over

    def _refer(self) -> None:
        """Make the kernel write into the present block of the history."""
        look, history, n = self.stepper.look, self.history, self.stepper.n
        rows = history.rows(n)
        self._rows = rows if self.times is None else Rows(*(array[:0] for array in rows))
        if look:
            look.save_outputs(history.outputs)
        if self.times is not None:
            look.want(self.times)
            look.save_wanted(history.arrays, n)

    def begin(self, earlier: Run | None = None, count: int = 0) -> Any:
        """Save the first state, or the first `count` rows of an earlier part, and return the run."""
        stepper = self.stepper
        if earlier:
            self.history.take(earlier.saved or {}, earlier.saved_outputs, count)
            self._refer()
        elif self.times is None or self.times[0] == stepper.t0:
            self._write_present(0.0)
            if self.times is not None:
                stepper.counters[NEXT] = 1
        if self.place:
            try:
                self._keep()  # the first record
            except BaseException:
                self.history.remove()
                raise
        return self

    def _write_present(self, step: float) -> None:
        """Save the present state in the next row."""
        stepper = self.stepper
        values = {"t": stepper.t, "steps": step, "u": stepper.u, "v": stepper.v}
        self.history.write(values, stepper.look.present_outputs() if self.history.outputs else {})

    # Results ----------------------------------------------------------------------------------------------------------

    def close(self) -> None:
        """Complete the rows: no more rows are written."""
        if self.saved is None:
            self._complete()
            self.history.close()
            self.saved, self.saved_outputs = self.history.whole(), self.history.whole_outputs()
            if self.times is not None:
                self.saved.setdefault("t", self.times[: self.history.row].copy())

    def _complete(self) -> None:
        """Save the last state."""
        raise NotImplementedError

    def result(self, error: BaseException | None = None) -> Solution:
        """Return the run so far, which can continue; `error` is the exception that ended it, if there was one."""
        self.close()
        assert self.saved is not None
        solution = self._solution(self.saved, self.saved_outputs)
        if not isinstance(error, Exception):
            solution._extend = lambda: self
            if solution.can_go_on:
                solution._resume = self.state
        return solution

    def _solution(self, rows: Mapping[str, np.ndarray], outputs: dict[str, np.ndarray]) -> Solution:
        """Return a solution with these rows, whose other values are computed when they are read."""
        fields = {**rows, **self._fields(), "outputs": outputs}
        fields |= {"status": self.status, "message": self.message, "reason": self.reason}
        later: dict[str, Callable[[], Any]] = {"notes": self.all_notes}
        if "t" not in rows:
            later["t"] = partial(self._grid, len(rows["u"]))
        return solution_of(self.stepper, fields, later)

    def _grid(self, count: int, first: int = 0) -> np.ndarray:
        """Return the times of the rows from `first` to `count` of a run that does not save times."""
        raise NotImplementedError

    def _place(self, save_to: str | PathLike[str] | None) -> Place | None:
        """Return the place of a run that continues this closed run.

        Raises
        ------
        ValueError
            If save_to is not given, and this run has many states in files.
        """
        if save_to is not None:
            return Place.of(save_to, self.stepper.system.labels, self.stepper.system.first_order)
        rows = *(self.saved or {}).values(), *self.saved_outputs.values()
        in_files = sum(array.nbytes for array in rows if isinstance(array, np.memmap))
        if in_files > _MOST_JOINED:
            raise ValueError(
                f"save_to must name a new directory for the whole history: {in_files:.3g} bytes of states are in the "
                f"files of this run, and at most {_MOST_JOINED:.3g} are copied into memory."
            )
        return None

    def _invariant_notes(self, remedy: str) -> list[str]:
        """Return a sentence about each invariant that grew steadily or drifted far; `remedy` is the advice.

        There is no note for stochastic methods, because the energy grows from a cold start, and none for a run that
        diverged, which has a message.
        """
        stepper, notes = self.stepper, []
        if stepper.look and not stepper.method.is_stochastic and self.status is not Status.DIVERGED:
            look, h = stepper.look, self._fields()["h"]
            for name, k in look.followed.invariants.items():
                is_balance = look.followed.work[k] >= 0
                grown = self.status is Status.COMPLETED and growth(stepper, k, h)
                far = 0.0 if grown else excess(stepper, k, h)
                if grown:
                    notes.append(growth_note(name, grown, is_balance, stepper.method, remedy))
                elif far:
                    notes.append(drift_note(name, look.drift_of(k), far, is_balance, remedy))
        return notes

    def all_notes(self) -> tuple[str, ...]:
        """Sentences that the user should read."""
        return (*self._notes(), *self._half_turns(), *self._idle_notes(), *self.stepper.notes)

    def _half_turns(self) -> Iterator[str]:
        """Describe an angle between two bodies that passes half a turn, if a torque jumps there."""
        rows, angles = self.saved, mark(self.stepper.system.rhs, "angles")
        if rows and angles:
            t = rows["t"] if "t" in rows else self._grid(len(rows["u"]))
            yield from half_turns(angles, self.stepper.params, t, rows["u"], rows["v"])

    def _idle_notes(self) -> list[str]:
        """Return a sentence about each event of the user whose `apply` never changed the state."""
        look, system = self.stepper.look, self.stepper.system
        found = look.occurrences() if look and system.form is VECTOR else {}
        return [
            f"apply of events[{name!r}] changed nothing: write entries, such as v[0] = ..., because v = ... makes "
            "another array."
            for name, event in system.events.items()
            if type(event) is Event and event.apply and len(found.get(name, ())) and not len(found[name].jumps)
        ]

    def extend(
        self,
        t_end: float,
        *,
        save_to: str | PathLike[str] | None,
        progress: bool,
        raise_on_failure: bool,
        cancel: Cancel | None,
        t_eval: Any = None,
    ) -> Solution:
        """Continue from the end of the run, as `Solution.extend` describes."""
        return carry_out(lambda: self.extended(t_end, progress, save_to, t_eval), cancel, raise_on_failure)

    def error(self, solution: Solution, cancel: Cancel | None, coarser: float | None = None) -> ErrorEstimate | None:
        """Estimate the error of the solution of this run; None if a compared run was interrupted.

        If it is known how much larger the error of a coarser run is, see `ErrorEstimate`, one further run is enough.

        Raises
        ------
        ValueError, MemoryError
            If the method adds random numbers, or the error does not fit in memory.
        """
        check_repeatable(self.stepper.method)
        check_error(solution.t, solution.u, solution.v, *solution.outputs.values(), *solution.z.values())
        try:
            error = self.error_of(solution, coarser, cancel)
            if may_be_lost(solution, error):
                error = self._with_time(error, cancel)
        except _InterruptedComparisonError:
            return None
        look = self.stepper.look
        invariants = look.followed.invariants if look else {}
        starts = {name: look.start_of(k) for name, k in invariants.items() if look.followed.work[k] < 0}
        return replace(error, notes=(*error.notes, *losses(solution, error, starts)))

    def _with_time(self, error: ErrorEstimate, cancel: Cancel | None) -> ErrorEstimate:
        """Return an error with the time up to which digits are right, from the same run with more saved states."""
        run = self.with_states(max(2, min(_STATES, _VALUES // self.stepper.n)))
        other = run.error_of(compared(run.begin, cancel), None, cancel)
        until = error.reliable_until if other.reliable_until is None else other.reliable_until
        return replace(error, reliable_until=until, notes=other.notes)

    def _keep(self) -> None:
        """Write the results so far at intervals: they remain if the process is killed."""
        assert self.place
        assert self.history.files
        self.place.keep(self.history.files, self.history.count, self._so_far)

    def _so_far(self) -> Solution:
        """Return the solution of a running run; its rows are in files."""
        solution = self._solution(self.history.whole(), self.history.whole_outputs())
        solution.status, solution._resume = Status.INTERRUPTED, self.state
        solution.notes = tuple(self.stepper.notes)
        return solution


def check_repeatable(method: Method) -> None:
    """Refuse a method whose runs with other steps have other random numbers."""
    if method.is_stochastic:
        raise ValueError(f"check compares runs with other steps, but {method!r} adds random numbers.")


class _InterruptedComparisonError(Exception):
    """`cancel` ended a compared run, which then shows no error."""


def compared(begin: Callable[[], Run], cancel: Cancel | None) -> Solution:
    """Run to its end a run that is compared with another run."""
    solution = carry_out(begin, cancel, raise_on_failure=False)
    if solution.status is Status.INTERRUPTED:
        raise _InterruptedComparisonError
    return solution


def carry_out(begin: Callable[[], Run], cancel: Cancel | None, raise_on_failure: bool) -> Solution:
    """Begin a run, and run it to its end."""
    if raise_on_failure is not False:
        check_flag(raise_on_failure, "raise_on_failure")
    if cancel is not None:
        check_cancel(cancel)
    run = None
    try:
        with DeferredInterrupt() as interrupt:
            run = begin()
            run.march(Stop(interrupt, cancel))
            if not run.is_suspect:
                solution = _finished(run)
        if run.is_suspect:
            run.judge_growth()  # Ctrl-C may interrupt it, because it takes some time
            with DeferredInterrupt():
                solution = _finished(run)
    except BaseException as error:  # raised by a function, or after Ctrl-C
        with DeferredInterrupt() as again:
            if run:
                error.solution = _after(run, error)  # type: ignore[attr-defined]
            elif isinstance(error, KeyboardInterrupt):
                error.solution = None  # type: ignore[attr-defined]
            if isinstance(error, KeyboardInterrupt):
                again.forget()  # it is raised now
        raise
    if raise_on_failure and not solution.success:
        raise IntegrationError(solution)
    return solution


def _finished(run: Run) -> Solution:
    """Return a run that has ended, and write it to its place."""
    solution = run.result()
    if run.place:
        _write(run, solution)
    return solution


def _after(run: Run, error: BaseException) -> Solution:
    """Return the run up to an exception, and write it to its place."""
    is_open = isinstance(error, Exception) or run.is_suspect or not run.is_done
    if run.status is Status.COMPLETED and is_open:
        what = f"raised {type(error).__name__}" if isinstance(error, Exception) else "was interrupted"
        run._end(Status.INTERRUPTED, f"The run {what} after t = {run.stepper.t:g}.")
    solution = run.result(error)
    if run.place:
        with contextlib.suppress(OSError):  # the directory then has the last record
            _write(run, solution)
    return solution


def _write(run: Run, solution: Solution) -> None:
    """Write the solution, except the rows, to the place of the run."""
    assert run.place
    assert run.history.files
    run.place.write(solution, run.history.files, len(solution.t), has_ended=True)


def solution_of(stepper: Any, fields: dict[str, Any], later: dict[str, Callable[[], Any]]) -> Solution:
    """Return the solution of a run that is completed, unless `fields` say otherwise.

    It has these fields, and the fields of each kind of run; `later` computes fields when they are read.
    """
    system, counters = stepper.system, stepper.counters
    fields = {
        "n_steps": stepper.index,
        "n_rhs": 1 + int(counters.item(EVALUATIONS)),
        "n_iterations": int(counters.item(ITERATIONS)),
        "n_invariants": stepper.look.n_invariants(stepper.index, counters) if stepper.look else 0,
        "status": Status.COMPLETED,
        "message": COMPLETED,
        "kernel_seconds": stepper.seconds,
        "method": system.method,
        "labels": system.labels,
        "_accelerations": None if system.history else partial(accelerations, system.callback, stepper.p),
        **fields,
    }
    if stepper.look:
        later = later | stepper.look.found()
    solution = Solution._of(fields, later)
    if system.first_order.names:
        solution._separate(system.first_order)
    return solution


def growth_note(name: str, growth: float, is_balance: bool, method: Method, remedy: str) -> str:
    """Return a sentence about the steady growth of an invariant, or of an energy minus the work."""
    percent = f"by {100 * growth:.2g} %"
    if is_balance:
        amount = f"{percent} of the larger of the two" if math.isfinite(growth) else _OVERFLOW
        return f"{name} minus the work grows steadily, {amount} over the run: {method!r} adds energy; {remedy}."
    amount = percent if growth < 1 else f"to {1 + growth:.3g} times its size"
    amount = amount if math.isfinite(growth) else _OVERFLOW
    unstable = "slowly unstable" if growth < _FAST else "unstable"
    return (
        f"{name} grows steadily, {amount} over the run; if the motion should keep it, {method!r} is {unstable} here: "
        f"{remedy}."
    )


def drift_note(name: str, drift: float, far: float, is_balance: bool, remedy: str) -> str:
    """Return a sentence about an invariant whose drift is far larger than its terms."""
    name += " minus the work" * is_balance
    return (
        f"{name} drifts by {drift:.2g}, {far:.2g} times the size of its terms at the start; if the motion should keep "
        f"it, the run is wrong: {remedy}."
    )


def unwritten_entry(j: int, t: float) -> ValueError:
    """Return the error for an entry of a that rhs does not write at the time t."""
    return ValueError(
        f"rhs does not write a[{j}] at t = {t:g}, so that a[{j}] keeps its value from an earlier evaluation; write "
        "every a[j] in every evaluation."
    )


def ended_by_event(ended: int, name: str, t: float) -> tuple[Status, str]:
    """Return the status and the message of a run that an event ended."""
    if ended == TERMINAL:
        return Status.TERMINATED, f"The event {name!r} ended the run at t = {t:g}."
    if ended == RESTING:
        return Status.ZENO, (
            f"From t = {t:g} on, the state rests on the surface g = 0 of the event {name!r}, and is pushed through it. "
            "A reset acts at one moment and cannot hold it there: end the run with terminal=True, or add a force that "
            "holds it."
        )
    return Status.ZENO, (
        f"The resets of the event {name!r} follow each other at t = {t:g} in ever shorter times, like the impacts of a "
        "ball that comes to rest: end the run earlier with a terminal event, or add a force that holds the state at "
        "rest."
    )
