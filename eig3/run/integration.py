"""`integrate`: run a whole time history. A Python loop calls the kernel for one chunk of steps after the other."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..diagnosis.coarseness import coarseness
from ..diagnosis.divergence import Divergence, find_blow_up, find_divergence
from ..functions.checks import (
    check_cancel,
    check_count,
    check_flag,
    check_h,
    check_resolution,
    check_span,
    check_state,
    check_time,
)
from ..functions.events import Event
from ..functions.quantities import Functions, Quantity, check_functions
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.protocol import VECTOR
from ..methods import EIG, Method
from ..result import storage
from ..result.memory import check_disk, check_history
from ..result.solution import Solution, Status
from ..result.storage import Place, whole_rows
from ..stability import alternating_limit
from ..stepping.stepper import NEVER, Cancel, Stepper
from ..stepping.tolerances import check_tolerances, method_for
from ..stepping.variable_stepper import VariableStepper
from ..stepping.watched_stepper import WatchedStepper
from ..stepping.watching import check_events, ended_by_event
from .chunk import Chunk, Observer
from .growth import Growth
from .history import History, Saved
from .invariants import Watch
from .outputs import Output
from .progress import Progress, check_progress
from .variable_run import VariableRun
from .written import Written

_CHUNK_SECONDS = 0.1  # duration of a chunk, after which its observers see it
_CHUNK_GROWTH = 16  # largest factor from the steps of a watched chunk to the steps of the next
_LARGEST_GRADE = 7  # of EIG for a force that reads the velocity, before a note advises against it
_FIRST_WATCHED = 4096  # steps of the first chunk, if there are invariants or outputs


class IntegrationError(RuntimeError):
    """A run with ``raise_on_failure=True`` did not complete.

    Attributes
    ----------
    solution : Solution
        The part of the run that was computed.
    """

    def __init__(self, solution: Solution) -> None:
        super().__init__(solution.message)
        self.solution = solution

    def __reduce__(self) -> tuple:
        return type(self), (self.solution,)


def integrate(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: float | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    params: ArrayLike = (),
    method: str | Method | None = None,
    save_every: int | None = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event] | None = None,
    invariants: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    h_max: float | None = None,
    first_step: float | None = None,
    max_steps: int | None = None,
    inline: bool = False,
    progress: bool = False,
    raise_on_failure: bool = False,
    cancel: Cancel | None = None,
    save_to: str | PathLike[str] | None = None,
) -> Solution:
    """Integrate u'' = f(t, u, v) in compiled code, with a fixed step h or with tolerances rtol and atol.

    The page eig3/run/README.md explains the options by examples.

    Parameters
    ----------
    rhs : jitted function
        The acceleration: ``f(t, u, v, p) -> a`` for one degree of freedom, and ``f(t, u, v, p, a)``, which writes every
        a[j], for n. Decorate it with ``@eig3.jit``. It must not write to u, v or p.
    t_span : (float, float)
        First and last time.
    u0, v0 : float or array_like, shape (n,)
        Displacement and velocity at the first time: floats for the first form of rhs, arrays for the second.
    h : float
        The fixed step. If it does not divide the span, the run takes the next shorter step that does.
    rtol, atol : float; atol also array_like, shape (n,) or (2, n)
        Tolerances, which bound the estimated error of each step by ``atol + rtol * size``. Without atol, a size is the
        largest |u| so far of a degree of freedom, or its largest |v|; with atol, it is that of the value itself.
    params : float or array_like
        The parameters. rhs gets them as p, a one-dimensional array of float64.
    method : str or Method
        A name in `eig3.METHODS` such as "eig9", or a record such as ``EIG3(alpha=1.2)``; by default "eig3". With rtol
        "rk5", "rk8" or "eig3"; by default "rk8" for rtol below 1e-4, and "rk5" otherwise.
    save_every : int or None
        Save every `save_every`-th state, the first and the last. None saves only the first and the last.
    t_eval : array_like, shape (m,)
        Save the states at these increasing times instead, from the dense output within the steps.
    events : dict of str to Event
        Functions of the state whose zeros are found, by name; see `eig3.Event`.
    invariants : dict of str to jitted function
        Functions ``e(t, u, v, p) -> float`` by name, evaluated at every step. The solution has their `drift` and
        `extremes`.
    outputs : dict of str to jitted function, or to (jitted function, k)
        Functions ``f(t, u, v, p) -> float``, or ``f(t, u, v, p, out)`` for k values, by name. `solution.outputs` has
        their values at the saved states, and `solution.extremes` their extremes over the run.
    h_max, first_step, max_steps : float, float, int
        With rtol: the longest and the first step, and the number of steps after which the run ends.
    inline : bool
        Compile the loop with rhs inside: faster for long runs, for about a second of compilation in each process.
    progress, raise_on_failure : bool
        Show a progress bar, by tqdm. Raise `IntegrationError` if the run does not complete.
    cancel : threading.Event
        Set it in another thread to end the run.
    save_to : str or path
        A new or empty directory, to which the run writes its history while it goes on; `eig3.load` reads it.

    Returns
    -------
    Solution
        Its `status` says how the run ended. A run that fails returns the states up to the last good one.

    Raises
    ------
    TypeError, ValueError, ImportError
        An argument is not valid, or tqdm is missing. These errors are raised before the run starts.
    MemoryError, OSError
        The history does not fit in memory, or on the disk of `save_to`.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` is the run up to then; None if no run had started. What rhs raises is
        raised too, with the same attribute.
    """

    def begin() -> _Run | VariableRun:
        span = check_span(t_span)
        check_progress(progress)
        functions = check_functions(invariants, outputs)
        common: dict[str, Any] = {"params": params, "inline": inline, "events": events, "t_eval": t_eval}
        if t_eval is not None and save_every not in (1, None):
            raise ValueError("save_every and t_eval exclude each other: give one of them.")
        if t_eval is not None and save_to is not None:
            raise ValueError("save_to and t_eval exclude each other: the states at the times of t_eval are in memory.")
        place = None if save_to is None else Place.of(save_to)
        if h is not None:
            _refuse({"rtol": rtol, "atol": atol, "h_max": h_max, "first_step": first_step, "max_steps": max_steps})
            return _fixed_run(rhs, span, u0, v0, h, method, save_every, functions, progress, place, **common)
        limits = rtol, atol, h_max, first_step, max_steps
        return _variable_run(rhs, span, u0, v0, limits, method, save_every, functions, progress, place, **common)

    return _carry_out(begin, cancel, raise_on_failure)


def _carry_out(begin: Callable[[], _Run | VariableRun], cancel: Cancel | None, raise_on_failure: bool) -> Solution:
    """Begin a run, and take it to its end."""
    check_flag(raise_on_failure, "raise_on_failure")
    run = None
    try:
        with DeferredInterrupt() as interrupt:
            stop = _Stop(interrupt, check_cancel(cancel))
            run = begin()
            run.march(stop)
        if isinstance(run, _Run):
            run.judge_growth()  # which Ctrl-C may end, because it takes some time
        with DeferredInterrupt():
            solution = _result(run)
            _write(run, solution)
    except BaseException as error:  # raised by rhs, or after Ctrl-C
        with DeferredInterrupt() as again:
            if run or isinstance(error, KeyboardInterrupt):
                error.solution = run and _result(run, error)  # type: ignore[attr-defined]
            if run:
                with contextlib.suppress(OSError):  # the directory is then as the last record says
                    _write(run, error.solution)  # type: ignore[attr-defined]
            if isinstance(error, KeyboardInterrupt):
                again.forget()  # it is raised now
        raise
    if raise_on_failure and not solution.success:
        raise IntegrationError(solution)
    return solution


def _result(run: _Run | VariableRun, error: BaseException | None = None) -> Solution:
    """Return the run up to now, which can go on; `error` is the exception that ended it, if there was one."""
    solution = run.result(error)
    if not isinstance(error, Exception):  # after which some observers may not have seen the last chunk
        solution._extend = partial(_extend, run)
        if solution.can_go_on:
            solution._resume = run.state
    return solution


def with_functions(
    solution: Solution,
    rhs: Any,
    *,
    events: Any = None,
    invariants: Any = None,
    outputs: Any = None,
    jacobian: Any = None,
) -> Solution:
    """Give a loaded solution the functions of its run, as `eig3.load` describes it, and return it."""
    state = solution._state
    if state is None:
        why = "it is a copy, has t_eval, is a member of an ensemble, or ended with an exception"
        if not solution.can_go_on:
            why = f"its status is {solution.status.name}"
        raise ValueError(f"this run cannot go on: {why}; load it without functions.")
    given: dict[str, Any] = {"events": check_events(events), **check_functions(invariants, outputs)._asdict()}
    names: dict[str, Mapping[str, Any]]
    names = {"events": solution.events, "invariants": solution.drift, "outputs": solution.outputs}
    for argument, known in names.items():
        if set(known) != set(given[argument]):
            wanted = ", ".join(map(repr, known)) or "none"
            raise ValueError(f"{argument} must have the names of those of the run: {wanted}.")
        given[argument] = {name: given[argument][name] for name in known}
    if (jacobian is not None) != state["has_jacobian"]:
        what = "the method of the run has a jacobian: give" if jacobian is None else "the run has none: leave out"
        raise ValueError(f"{what} jacobian.")
    if jacobian is not None:
        solution.method = dataclasses.replace(solution.method, jacobian=jacobian)  # type: ignore[type-var]
        solution.notes = tuple(note for note in solution.notes if note != storage.WITHOUT_JACOBIAN)
    kind: Any = _Ended if "h" in state else VariableRun
    run = kind.restored(solution, rhs, given.pop("events"), Functions(**given))
    solution._accelerations = run.stepper.accelerations
    if isinstance(run, VariableRun):
        solution._between = run.between
    solution._extend = partial(_extend, run)
    return solution


def _write(run: _Run | VariableRun, solution: Solution) -> None:
    """Write the solution, whose rows are written, to the place of the run, if it has one."""
    if run.place:
        run.place.write(solution, len(solution.t), has_ended=True)


def _refuse(given: dict[str, Any]) -> None:
    """Refuse options of tolerances beside h."""
    for name, value in given.items():
        if value is not None:
            what = "the steps follow from it" if name == "rtol" else "it belongs to rtol"
            raise ValueError(
                f"h and {name} exclude each other: give h for a fixed step, or rtol for tolerances ({what})."
            )


def _fixed_run(
    rhs: Any,
    span: tuple[float, float],
    u0: ArrayLike,
    v0: ArrayLike,
    step: float,
    method: str | Method | None,
    save_every: int | None,
    functions: Functions,
    progress: bool,
    place: Place | None,
    *,
    events: Any,
    t_eval: ArrayLike | None,
    **options: Any,
) -> _Run:
    """Return a run with a fixed step at its start."""
    t0, t1 = span
    n_steps, h = divide(t1 - t0, check_h(step))
    check_resolution(h, t0, t1)
    save_every = None if t_eval is not None else save_every
    every = _stride(save_every, n_steps)
    options |= {"h": h, "t0": t0, "method": "eig3" if method is None else method}
    stepper = _stepper(rhs, u0, v0, t1, events, t_eval, options)
    _check_space(place, n_steps, every, stepper.n, functions.n_outputs)
    watched, shown = functions.quantities(stepper.form)
    width = _width(stepper, watched, shown)
    directory = place.directory if place else None
    history = History(n_steps, every, stepper, t1, width, functions.shapes, directory)
    return _Run(
        stepper,
        n_steps,
        save_every,
        history,
        [Watch(name, quantity, stepper, t1, functions.work_in(name)) for name, quantity in watched.items()],
        [Output(name, quantity, stepper, history.outputs[name]) for name, quantity in shown.items()],
        Growth(stepper, n_steps),
        progress,
        place,
    )


def _stepper(
    rhs: Any, u0: ArrayLike, v0: ArrayLike, t_end: float, events: Any, t_eval: ArrayLike | None, options: dict[str, Any]
) -> Stepper:
    if check_events(events) or t_eval is not None:
        return WatchedStepper(rhs, u0, v0, t_end=t_end, events=events, t_eval=t_eval, **options)
    return Stepper(rhs, u0, v0, **options)


def _width(stepper: Stepper, watched: Mapping[str, Quantity], shown: Mapping[str, Quantity]) -> int:
    """Return the `width` of the history of a run."""
    return max([stepper.n, *(q.width for q in shown.values())]) if watched or shown else 0


def _variable_run(
    rhs: Any,
    span: tuple[float, float],
    u0: ArrayLike,
    v0: ArrayLike,
    limits: tuple,
    method: str | Method | None,
    save_every: int | None,
    functions: Functions,
    progress: bool,
    place: Place | None,
    **options: Any,
) -> VariableRun:
    """Return a run with tolerances at its start."""
    rtol, atol, h_max, first_step, max_steps = limits
    if rtol is None and atol is None:
        raise ValueError("give h for a fixed step, or rtol for tolerances: one of the two is needed.")
    n = max(1, np.size(check_state(u0, v0)[0]))
    tolerances = check_tolerances(n, rtol, atol, h_max, first_step, max_steps)
    options |= {"method": method_for(method, tolerances.rtol), "tolerances": tolerances}
    stepper = VariableStepper(rhs, span, u0, v0, **options)
    every = NEVER if save_every is None else check_count(save_every, "save_every")
    return VariableRun.begin(stepper, every, functions, progress, place)


def _extend(
    run: _Run | _Ended | VariableRun,
    t_end: float,
    *,
    save_to: str | PathLike[str] | None,
    progress: bool,
    raise_on_failure: bool,
    cancel: Cancel | None,
) -> Solution:
    """Go on from the end of a run, as `Solution.extend` describes it."""
    return _carry_out(lambda: run.extended(t_end, progress, save_to), cancel, raise_on_failure)


def _stride(save_every: int | None, n_steps: int) -> int:
    """Return the number of steps from one saved state to the next."""
    return n_steps if save_every is None else min(check_count(save_every, "save_every"), n_steps)


def _check_space(place: Place | None, n_steps: int, every: int, n: int, n_outputs: int) -> None:
    """Raise an error if the history does not fit in memory, or on the disk if it has a place there."""
    if place is None:
        check_history(n_steps, every, n, n_outputs)
    else:
        check_disk(place.directory, n_steps, every, n, n_outputs)


def _steps_until(stepper: Stepper, t_end: float) -> int:
    """Return the number of steps of a run that goes on from the state of a stepper to t_end."""
    t_end, t0, h = check_time(t_end, "t_end"), stepper.t0, stepper.h
    check_resolution(h, t0, t_end)
    n_steps = max(stepper.index + 1, round((t_end - t0) / h))
    nearest = t0 + n_steps * h
    if abs(nearest - t_end) > 1e-12 * n_steps * h + 2 * np.spacing(max(abs(t0), abs(t_end))):
        raise ValueError(
            f"t_end must be a whole number of steps h = {h!r} after the end of the run at t = {stepper.t!r}, not "
            f"{t_end!r}; take t_end={nearest!r}."
        )
    return n_steps


def divide(span: float, h: float) -> tuple[int, float]:
    """Return the number of steps of at most `h` that fill `span`, and the length of these steps."""
    ratio = span / h
    if not ratio < 2**53:
        raise ValueError(
            f"h must be at least {span / 2**53:.3g} for this t_span, so that steps can be counted, not {h}."
        )
    # If h divides the span except for round-off, there must not be one more step.
    nearest = round(ratio)
    n_steps = max(1, nearest if math.isclose(ratio, nearest, rel_tol=1e-12) else math.ceil(ratio))
    return n_steps, span / n_steps


class _Stop:
    """Whether a chunk of steps should end: after Ctrl-C, after a cancellation, or after its usual duration."""

    def __init__(self, interrupt: DeferredInterrupt, cancel: Cancel | None) -> None:
        self._interrupt, self._cancel = interrupt, cancel
        self._until = 0.0

    def is_final(self) -> bool:
        """Return whether the run should end too."""
        return self._interrupt.is_set() or (self._cancel is not None and self._cancel.is_set())

    def begin_chunk(self) -> None:
        self._until = time.perf_counter() + _CHUNK_SECONDS

    def is_set(self) -> bool:
        return time.perf_counter() > self._until or self.is_final()


class _Ended(NamedTuple):
    """A run with a fixed step that has ended, with what it needs to go on."""

    stepper: Stepper
    save_every: int | None
    saved: Saved
    watches: list[Watch]
    outputs: list[Output]
    growth: Growth

    @classmethod
    def restored(cls, solution: Solution, rhs: Any, events: Mapping[str, Event], functions: Functions) -> _Ended:
        """Return the run of a loaded solution; the names of its functions are right."""
        state = solution._state or {}
        t_end, n_steps = float(solution.t[-1]), check_count(state["n_steps"], "n_steps")
        options = {name: state[name] for name in ("h", "t0", "params", "inline")} | {"method": solution.method}
        u0, v0 = state["start"]
        stepper = _stepper(rhs, u0, v0, t_end, events, None, options)
        watched, shown = functions.quantities(stepper.form)
        watches = [Watch(name, each, stepper, t_end, functions.work_in(name)) for name, each in watched.items()]
        outputs = [Output(name, quantity, stepper, np.empty((1, *quantity.shape))) for name, quantity in shown.items()]
        growth = Growth(stepper, n_steps)
        with storage.going_on():
            stepper.restore(state["stepper"])
            if isinstance(stepper, WatchedStepper):
                stepper.watching.recall(solution.events)
            growth.restore(state["growth"], stepper)
            for watch in watches:
                watch.restore(state["invariants"][watch.name])
            for output in outputs:
                output.restore(state["outputs"][output.name])
            t, u, v = whole_rows(solution, stepper.n)
            if len(t) <= stepper.index // _stride(state["save_every"], n_steps):
                raise ValueError(f"{len(t)} states are too few.")
        saved = Saved(t, u, v, solution.outputs, _width(stepper, watched, shown))
        return cls(stepper, state["save_every"], saved, watches, outputs, growth)

    def extended(self, t_end: float, progress: bool, save_to: str | PathLike[str] | None) -> _Run:
        """Return an independent run to a later end, which stands where this one ended."""
        check_progress(progress)
        n_steps = _steps_until(self.stepper, t_end)
        every = _stride(self.save_every, n_steps)
        place = None if save_to is None else Place.of(save_to)
        stepper = self.stepper.extended(t_end)
        _check_space(place, n_steps, every, stepper.n, sum(output.width for output in self.outputs))
        shapes = {output.name: output.shape for output in self.outputs}
        history = History(n_steps, every, stepper, t_end, self.saved.width, shapes, place.directory if place else None)
        history.take(self.saved, stepper)
        earlier = {name: values[: stepper.index // every + 1] for name, values in self.saved.outputs.items()}
        return _Run(
            stepper,
            n_steps,
            self.save_every,
            history,
            [watch.extended(stepper.t, t_end) for watch in self.watches],
            [output.extended(history.outputs[output.name], earlier[output.name]) for output in self.outputs],
            self.growth.extended(n_steps, stepper.index),
            progress,
            place,
        )


class _Run:
    """A run in chunks of steps, with its observers."""

    def __init__(
        self,
        stepper: Stepper,
        n_steps: int,
        save_every: int | None,
        history: History,
        watches: list[Watch],
        outputs: list[Output],
        growth: Growth,
        progress: bool,
        place: Place | None,
    ) -> None:
        self.stepper, self.n_steps, self.save_every, self.history = stepper, n_steps, save_every, history
        self.watches, self.outputs, self.growth, self.place = watches, outputs, growth, place
        self._n_found = stepper.watching.n_found if isinstance(stepper, WatchedStepper) else 0
        self.bar = Progress(n_steps - stepper.index, "step") if progress else None
        self.observers: list[Observer] = [history, *watches, *outputs, growth]
        if self.bar:
            self.observers.append(self.bar)
        if stepper.form is VECTOR:
            self.observers.append(Written(n_steps))
        # Steps of a chunk whose observers take its duration.
        self.most_watched = _FIRST_WATCHED if watches or outputs else n_steps
        self.status = Status.COMPLETED
        self.message = "The run reached the end of its span."
        self.reason: Callable[[], str] | None = None
        if place:
            try:
                place.keep(self._rows, self._so_far)
            except BaseException:
                history.remove()
                raise

    def state(self) -> dict[str, Any] | None:
        """Return the state from which the run goes on, in numbers and arrays; None with `t_eval`."""
        stepper = self.stepper
        if isinstance(stepper, WatchedStepper) and stepper.watching.times is not None:
            return None
        return {
            "h": stepper.h,
            "t0": stepper.t0,
            "start": stepper.start,
            "params": stepper.params,
            "inline": stepper.inline,
            "has_jacobian": stepper.method.jacobian is not None,
            "n_steps": self.n_steps,
            "save_every": self.save_every,
            "stepper": stepper.kept(),
            "invariants": {watch.name: watch.kept() for watch in self.watches},
            "outputs": {output.name: output.kept() for output in self.outputs},
            "growth": self.growth.kept(),
        }

    def extended(self, t_end: float, progress: bool, save_to: str | PathLike[str] | None) -> _Run:
        """Return an independent run to a later end, which stands where this one ended."""
        saved = self.history.close(self.stepper, self.outputs)
        ended = _Ended(self.stepper, self.save_every, saved, self.watches, self.outputs, self.growth)
        return ended.extended(t_end, progress, save_to)

    def march(self, stop: _Stop) -> None:
        """Run to the end, or until the run fails or should stop."""
        try:
            # A chunk in the middle of the run shows the size of a motion that starts at rest.
            self._march_to(self.n_steps // 2 if self.growth.needs_half else self.n_steps, stop)
            self._march_to(self.n_steps, stop)
        finally:
            if self.bar:
                self.bar.close()
        self.stepper.note_pace()

    def _march_to(self, end: int, stop: _Stop) -> None:
        stepper, most, growth = self.stepper, end, 0
        raised: tuple[int, Exception] | None = None
        while self.status is Status.COMPLETED and stepper.index < end:
            if stop.is_final():
                self._end(Status.INTERRUPTED, f"The run was interrupted after t = {stepper.t:g}.")
                return
            stop.begin_chunk()
            count = min(most, end - stepper.index, self.history.most, self.most_watched)
            try:
                chunk = self.history.advance(stepper, count, stop)
            except Exception as error:
                if count == 1 or stepper.raised_before is None:
                    stepper.back()  # the observers have not seen the steps of this chunk
                    raise
                raised = stepper.raised_before, error
                # Take the steps before the one that raises: double the steps of a chunk, and halve them from then on.
                most, growth = (count // 2, 1) if growth else (1, 2)
                continue
            most *= growth or 1
            if not stepper.is_finite:
                chunk = self._end_diverged(chunk)
            elif stepper.failed:
                self._end_unsolved()
            elif stepper.is_over:
                self._end(*ended_by_event(stepper))
            begin = time.perf_counter()
            for observer in self.observers:
                observer.see(chunk)
            if isinstance(stepper, WatchedStepper) and stepper.watching.n_found > self._n_found:
                states = stepper.watching.states_from(self._n_found)
                followed: list[Watch | Output] = [*self.watches, *self.outputs]
                for quantity in followed:
                    quantity.widen(*states)
                self._n_found = stepper.watching.n_found
            if self.watches or self.outputs:
                seconds = time.perf_counter() - begin + 1e-9
                steps = stepper.index - chunk.first
                self.most_watched = max(1, int(steps * min(_CHUNK_GROWTH, _CHUNK_SECONDS / seconds)))
            if self.place and self.status is Status.COMPLETED:
                self.place.keep(self._rows, self._so_far)
            if raised and stepper.index >= raised[0]:
                raise raised[1]  # it did not come from rhs, but from the handler of a signal

    def _end(self, status: Status, message: str, reason: Callable[[], str] | None = None) -> None:
        self.status, self.message, self.reason = status, message, reason

    def _end_diverged(self, chunk: Chunk) -> Chunk:
        """End the run at its last finite state, and return the part of the chunk up to that state."""
        divergence = find_divergence(self.stepper)
        self.stepper = divergence.last
        self._end(Status.DIVERGED, divergence.message, divergence.explain)
        return chunk.until(self.stepper)

    def _end_unsolved(self) -> None:
        stepper = self.stepper
        if not math.isfinite(stepper.residual):
            divergence = Divergence(stepper, stepper.failed_degree, stepper.before())
            self._end(Status.DIVERGED, divergence.message, divergence.explain)
            return
        remedies = ["a smaller h", "more max_iterations", "a larger tol"]
        if not stepper.running.formulas.matrix:
            remedies.append("solver='newton'")
        self._end(
            Status.NOT_CONVERGED,
            f"{stepper.method.label}'s solve for the velocity did not converge at t = {stepper.t + stepper.h:g}, where "
            f"its residual is {stepper.residual:.3g}; {', '.join(remedies[:-1])} or {remedies[-1]} may help.",
        )

    def judge_growth(self) -> None:
        """Change the status to DIVERGED if the motion stayed finite, but grew because of its step."""
        suspect = self.growth.suspect if self.status is Status.COMPLETED else None
        blow_up = suspect and find_blow_up(self.stepper, suspect)
        if blow_up:
            self._end(Status.DIVERGED, blow_up.message, blow_up.explain)

    def result(self, error: BaseException | None = None) -> Solution:
        """Return the run up to now; `error` is the exception that ended it, if there was one."""
        stepper = self.stepper
        if self.status is Status.COMPLETED:
            if isinstance(error, Exception):
                self._end(Status.INTERRUPTED, f"The run raised {type(error).__name__} after t = {stepper.t:g}.")
            elif error and (stepper.index < self.n_steps or self.growth.suspect):
                self._end(Status.INTERRUPTED, f"The run was interrupted after t = {stepper.t:g}.")
        t, u, v, outputs, _ = self.history.close(stepper, self.outputs)
        if isinstance(stepper, WatchedStepper):
            if stepper.index == self.n_steps or stepper.is_over:
                stepper.finish()
            rows = stepper.wanted_rows()
            if rows is not None:
                if self.status is Status.DIVERGED:  # the dense output of the last step may not be finite
                    rows = rows.at(slice(int(np.argmin([*np.isfinite(rows.u + rows.v).all(axis=1), False]))))
                t, (u, v) = rows.t, rows.in_form(stepper.form)
                outputs = {output.name: output.at(t, u, v) for output in self.outputs}
        solution = self._solution(t, u, v)
        self._describe(solution)
        solution.outputs = outputs
        return solution

    def _so_far(self) -> Solution:
        """Return a run that goes on, without its rows."""
        solution = self._solution(self.history.t[:1], self.history.u[:1], self.history.v[:1])
        solution.status = Status.INTERRUPTED
        self._describe(solution)
        solution.outputs, solution._resume = self.history.outputs, self.state
        return solution

    @property
    def _rows(self) -> int:
        """The number of rows that are complete while the run goes on."""
        return self.stepper.index // _stride(self.save_every, self.n_steps) + 1

    def _describe(self, solution: Solution) -> None:
        """Write what the observers have found, besides the rows, to a solution."""
        stepper = self.stepper
        followed: list[Watch | Output] = [*self.watches, *self.outputs]
        solution.drift = {watch.name: watch.drift for watch in self.watches}
        solution.extremes = {each.name: each.extremes for each in followed}
        if isinstance(stepper, WatchedStepper):
            solution.events = stepper.watching.occurrences()
        solution.notes = (*self._notes(solution.status), *stepper.notes)

    def _solution(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> Solution:
        """Return a solution without what the observers have found."""
        stepper = self.stepper
        return Solution(
            t=t,
            u=u,
            v=v,
            h=stepper.h,
            n_steps=stepper.index,
            n_rhs=stepper.n_rhs,
            n_iterations=stepper.n_iterations,
            status=self.status,
            message=self.message,
            kernel_seconds=stepper.seconds,
            method=stepper.method,
            reason=self.reason,
            _accelerations=stepper.accelerations,
        )

    def _coarseness(self) -> str:
        """Describe a step that is too long for the motion. A reset is a jump of the motion, not a turn."""
        stepper, history = self.stepper, self.history
        if isinstance(stepper, WatchedStepper) and any(event.apply for event in stepper.watching.events.values()):
            return ""
        return coarseness(stepper, history.u[: stepper.index + 1] if history.every == 1 else None)

    def _notes(self, status: Status) -> Iterator[str]:
        for watch in self.watches if status is Status.COMPLETED else ():
            if watch.growth:
                yield watch.note(self.stepper.method)
        if status is Status.COMPLETED and (coarse := self._coarseness()):
            yield coarse
        running = self.stepper.running
        if isinstance(running, EIG) and running.grade > _LARGEST_GRADE and not running.ignores_velocity:
            yield (
                f"{running.label} predicts the velocity from {running.grade - 2} accelerations: with damping its limit "
                f"is short (omega h = {alternating_limit(running.grade, 0.1):.3g} at xi = 0.1); take RK8 or a grade of "
                "5 to 7."
            )
