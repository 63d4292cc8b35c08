"""A run that advances by any number of steps in compiled code."""

from __future__ import annotations

import copy
import math
import operator
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..functions.accelerations import accelerations
from ..functions.callbacks import check_callback
from ..functions.checks import (
    check_cancel,
    check_flag,
    check_h,
    check_index,
    check_method,
    check_params,
    check_state,
    check_time,
    reals,
    velocity_refused,
)
from ..functions.guard import first_acceleration, guarded
from ..functions.inlining import inlined
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.loops.fixed import STACKED_DEGREES, inline_kernel, pointer_kernel
from ..kernels.protocol import DEGREE, EVALUATIONS, ITERATIONS, RESIDUAL, SCALAR, VECTOR, Run
from ..methods import Method
from ..result.memory import aligned, check_workspace
from .slices import Slices

NEVER = 2**62  # `every` of a run that writes no states
_FLOAT64 = np.dtype(np.float64)
# At the end of a slice, a kernel moves values between rows, which takes about as long as a step of a large system.
# There is nothing to move after a multiple of the steps in which the rows rotate.
_LARGE = 1000  # degrees of freedom from which on slices are such multiples


class Cancel(Protocol):
    """An object that says whether to stop, such as a `threading.Event`."""

    def is_set(self) -> bool:
        """Return True to stop."""


class Stepper:
    """Advance u'' = f(t, u, v) by any number of steps, and write states to arrays of the caller.

    `eig3.integrate` uses this class. Use it directly for co-simulation, real-time loops and timing.

    Parameters
    ----------
    rhs, u0, v0, params, method, inline
        As for `eig3.integrate`.
    h : float
        The step. Unlike `eig3.integrate`, this class never changes it.
    t0 : float
        The time of u0 and v0.

    Attributes
    ----------
    start : tuple of float or ndarray
        u0 and v0.
    n : int
        Number of degrees of freedom.
    first_acceleration : float or ndarray
        f(t0, u0, v0).
    h, t0 : float
        The step, and the time of u0 and v0.
    params : ndarray
        The parameters p.
    method : Method
        The requested method.
    running : Method
        The record that takes the steps: `method` with every option "auto" decided.
    changed_at : float or None
        The time from which the fallback of `method` takes the steps, because the solve of a step did not converge.
    index : int
        Number of steps taken.
    failed : bool
        Whether the solve of an implicit step failed in the last `advance`. The stepper is at the state before this
        step.
    raised_before : int or None
        The step index before which rhs raised an exception in the last `advance`; None if it did not.
    seconds : float
        Time spent in the kernel, s, without compilation.

    Raises
    ------
    TypeError, ValueError
        If `eig3.integrate` would refuse the arguments, or the right-hand side is not finite at the start.
    MemoryError
        If the matrix of an implicit method does not fit in memory.
    RuntimeError
        If two threads use the stepper at the same time; it is raised by the method that the second thread calls.
    """

    def __init__(
        self,
        rhs: Any,
        u0: ArrayLike,
        v0: ArrayLike,
        *,
        h: float,
        t0: float = 0.0,
        params: ArrayLike = (),
        method: str | Method = "eig3",
        inline: bool = False,
    ) -> None:
        self.h = check_h(h)
        self.t0 = check_time(t0, "t0")
        u, v, self.form = check_state(u0, v0)
        self.params = guarded(check_params(params))
        self.method = check_method(method)
        self.inline = check_flag(inline, "inline")
        self.index = 0
        self.seconds = 0.0
        self.changed_at: float | None = None
        self.failed = False
        self.raised_before: int | None = None
        self._rhs = rhs
        self._alone = _Alone()
        self._callback = check_callback(rhs, "rhs", self.form)
        self.start = u, v
        self.n = 1 if self.form is SCALAR else u.size
        self._nowhere = np.empty(0 if self.form is SCALAR else (0, self.n))
        self._tally = np.zeros(4)
        self.first_acceleration = a = first_acceleration(self._callback, self.form, self.t0, u, v, self.params)
        running = self.method.for_force(self._callback.reads_velocity, self.n)
        self._prepare(running)
        self._check_velocity(a)
        with np.errstate(over="ignore"):  # a past value that overflows makes the first step non-finite
            past = self._formulas.start(u, v, a, self.h)
        for k, values in enumerate((u, v, *past)):
            self._state[k] = values
        self._before = self._position()

    @property
    def is_over(self) -> bool:
        """Whether anything but the number of steps ended the run."""
        return False

    @property
    def is_within_step(self) -> bool:
        """Whether the run ended between the ends of two steps."""
        return False

    @property
    def has_begun_step(self) -> bool:
        """Whether a call of the kernel ended within a step, so that u and v are no state after a step."""
        return False

    @property
    def t(self) -> float:
        """The time reached, t0 + index h."""
        return self.t0 + self.index * self.h

    @property
    def u(self) -> Any:
        """The displacement: a float, or a new array of shape (n,)."""
        return self._component(0)

    @property
    def v(self) -> Any:
        """The velocity: a float, or a new array of shape (n,)."""
        return self._component(1)

    @property
    def n_rhs(self) -> int:
        """Number of evaluations of the right-hand side, including the one at the start."""
        return 1 + int(self._tally[EVALUATIONS])

    @property
    def n_iterations(self) -> int:
        """Number of iterations of an implicit method's solver."""
        return int(self._tally[ITERATIONS])

    @property
    def residual(self) -> float:
        """The residual of the last failed solve for v; NaN if a value was not finite at its first iteration."""
        return float(self._tally[RESIDUAL])

    @property
    def failed_degree(self) -> int:
        """The degree of freedom in which the last failed solve met a value that is not finite."""
        return int(self._tally[DEGREE])

    @property
    def is_finite(self) -> bool:
        """Whether u and v are finite. If they are not, they stay so in all later steps."""
        if self.form is SCALAR:
            return math.isfinite(self._state[0]) and math.isfinite(self._state[1])
        return bool(np.isfinite(self._state[:2]).all())

    @property
    def sizes(self) -> tuple[float, float]:
        """The largest |u| and the largest |v|."""
        if self.form is SCALAR:
            return abs(float(self._state[0])), abs(float(self._state[1]))
        u, v = np.maximum.reduce(np.abs(self._state[:2]), axis=1).tolist()
        return u, v

    def advance(
        self,
        count: int,
        every: int = NEVER,
        u_rows: np.ndarray | None = None,
        v_rows: np.ndarray | None = None,
        cancel: Cancel | None = None,
    ) -> int:
        """Take `count` steps.

        Parameters
        ----------
        count : int
            Number of steps.
        every : int
            Write the state after each step whose index, counted from t0, is a multiple of this. By default no state is
            written.
        u_rows, v_rows : ndarray, shape (rows,) or (rows, n), optional
            C-contiguous arrays of float64 for the states that are written, with at least one row for each of them.
        cancel : threading.Event, optional
            Set it in another thread to end the call soon.

        Returns
        -------
        int
            Number of steps taken. It is less than `count` if `cancel` is set, or if the solver of an implicit method
            failed, and `failed` is then True.

        Raises
        ------
        TypeError, ValueError
            If a count is not a whole number or is out of range, or the rows cannot hold the states.

        Notes
        -----
        After an exception from rhs, the stepper is at its state before the call. After Ctrl-C, which raises
        KeyboardInterrupt soon, it is at the state that it has reached.
        """
        count, every = operator.index(count), operator.index(every)
        if count < 0 or every < 1:
            raise ValueError(f"count must not be negative and every be at least 1, not {count} and {every}.")
        rows = (self.index + count) // every - self.index // every
        u_rows, v_rows = self._check_rows(u_rows, rows), self._check_rows(v_rows, rows)
        first = self.index
        interrupt = DeferredInterrupt()  # it is never set within an outer block, which asks `cancel` instead
        cancels = (interrupt,) if cancel is None else (interrupt, check_cancel(cancel))
        with interrupt, self._alone:
            self._save()
            self._take(count, every, u_rows, v_rows, cancels)
        return self.index - first

    def back(self) -> None:
        """Go back to the state before the last `advance`. `seconds` still includes its time."""
        with DeferredInterrupt(), self._alone:
            self._go_back()

    def fork(self) -> Stepper:
        """Return an independent stepper at the same state, as `copy.copy` does too."""
        with DeferredInterrupt(), self._alone:
            other = object.__new__(type(self))
            vars(other).update(vars(self))
            other._alone = _Alone()
            other._state, other._tally = aligned(self._state.shape), self._tally.copy()
            np.copyto(other._state, self._state)
        other._before, other._slices = other._position(), copy.copy(self._slices)
        return other

    __copy__ = fork

    def extended(self, t_end: float) -> Stepper:
        """Return an independent stepper at the same state of a run that ends at t_end."""
        return self.fork()

    def kept(self) -> dict[str, Any]:
        """Return what this stepper needs, besides its arguments, to go on: numbers and arrays.

        Of the rows of its state, the first have u, v and the past; the others are scratch.
        """
        numbers = {"index": self.index, "changed_at": self.changed_at, "seconds": self.seconds}
        return {**numbers, "state": self._state[: 2 + self._formulas.past].copy(), "tally": self._tally.copy()}

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Become the stepper that has returned `kept`; it has the same arguments.

        Raises
        ------
        ValueError
            If `kept` is that of another stepper.
        """
        if kept["changed_at"] is not None and not self._fall_back():
            raise ValueError(f"{self.method!r} has no other solver.")
        self.changed_at = None if kept["changed_at"] is None else float(kept["changed_at"])
        state, tally = (reals(kept[name], name) for name in ("state", "tally"))
        carried = self._state[: 2 + self._formulas.past]
        if state.shape != carried.shape or tally.shape != self._tally.shape:
            raise ValueError(f"a state of the shape {state.shape} does not belong to {self.method!r}.")
        if not (np.isfinite(tally[:2]).all() and (tally[:2] >= 0).all()):
            raise ValueError(f"{tally[:2]} are not the counts of a stepper.")
        carried[:], self._tally[:] = state, tally
        self.index, self.seconds = check_index(kept["index"]), float(kept["seconds"])
        self._before = self._position()

    def __deepcopy__(self, memo: dict) -> Stepper:
        return self.fork()

    def before(self) -> Stepper:
        """Return an independent stepper at the state before the last `advance`."""
        other = self.fork()
        other._before = self._before
        other._go_back()
        other._before = other._position()
        return other

    def _go_back(self) -> None:
        before = self._before
        if before.running is not self.running:
            self._prepare(before.running)
        self.index, self.changed_at = before.index, before.changed_at
        np.copyto(self._state, before.state)
        np.copyto(self._tally, before.tally)

    def restarted(self, h: float) -> Stepper:
        """Return a new stepper at t0, u0 and v0, with the step h."""
        options: dict[str, Any] = {"t0": self.t0, "params": self.params, "method": self.method, "inline": self.inline}
        return Stepper(self._rhs, *self.start, h=h, **options)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the solver of an implicit method, if the user may want to choose another solver."""
        if not self.running.is_implicit:
            return ()
        notes = []
        if self.changed_at is not None:
            notes.append(
                f"From t = {self.changed_at:g} on, {self.method.label} solves for the velocity by Newton's method, "
                "because fixed-point iteration took too long or did not converge."
            )
        n, running = self.n, self.running
        if running.formulas.matrix and running.jacobian is None and n * self.n_iterations > self.n_rhs / 2:
            notes.append(
                f"Most of the {self.n_rhs} evaluations are differences of rhs for Newton's method, {n} in each "
                "iteration: give a jacobian, or take solver='fixed-point' or another method."
            )
        return tuple(notes)

    def acceleration(self, t: float, u: Any, v: Any) -> Any:
        """Evaluate f(t, u, v): a float, or a new array of shape (n,).

        Raises
        ------
        ValueError
            If u or v has another shape than u0.
        """
        # The compiled function would read any other array as if it were a contiguous one of this size.
        u, v = np.asarray(u, dtype=np.float64, order="C"), np.asarray(v, dtype=np.float64, order="C")
        shape = () if self.form is SCALAR else (self.n,)
        if not u.shape == v.shape == shape:
            raise ValueError(f"u and v must have the shape of u0, {shape}, not {u.shape}, {v.shape}.")
        if self.form is SCALAR:
            return self._callback.call(float(t), float(u), float(v), self.params)
        a = np.full(u.size, np.nan)  # an entry that rhs does not write stays NaN
        self._callback.call(t, u, v, self.params, a)
        return a

    @property
    def accelerations(self) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
        """A function that evaluates f(t_i, u_i, v_i) at rows of states, and does not keep this stepper."""
        return partial(accelerations, self._callback, self.params)

    def find_unwritten(self) -> int | None:
        """Return an index j such that rhs, in the vector form, did not write a[j] in the last step, if any.

        This takes one evaluation, which `n_rhs` does not count.
        """
        t, u, v = self.t - self.h, self._state[0], self._state[1]  # no method has to evaluate rhs at the end of a run
        a = np.empty(u.size)
        a.fill(np.nan)
        try:
            self._callback.call(t, u, v, self.params, a)
            if not math.isnan(np.minimum.reduce(a)):
                return None
            other = np.zeros(u.size)  # a value that rhs computes may be NaN too
            self._callback.call(t, u, v, self.params, other)
        except Exception:  # rhs may fail at a time at which the method does not evaluate it
            return None
        unwritten = np.flatnonzero(np.isnan(a) & (other == 0))
        return int(unwritten[0]) if unwritten.size else None

    @property
    def pace(self) -> float | None:
        """Seconds per step of the last run with this right-hand side and kernel; None before the first run."""
        return self._callback.pace.get(self._pace_key)

    def note_pace(self) -> None:
        """Store the measured time per step for later runs."""
        if self.index:
            self._callback.pace[self._pace_key] = self.seconds / self.index

    def _prepare(self, running: Method) -> None:
        """Prepare the kernel of a record, and a state of the size that it needs."""
        self.running, n = running, self.n
        self._formulas = formulas = running.formulas
        check_workspace(running, n)
        self._pace_key = formulas, n, self.inline
        self._slices = Slices(self.pace, formulas.turn if n >= _LARGE else 1)
        self._settings = np.array(running.settings, dtype=np.float64)
        self._state = np.zeros(2 + formulas.past) if self.form is SCALAR else aligned((formulas.state_rows(n), n))
        jacobian = running.jacobian and check_callback(running.jacobian, "jacobian", self.form)
        self._callbacks = () if self.inline else (self._callback.address, jacobian and jacobian.address)
        self._kernel = self._compiled(running, jacobian)

    def _compiled(self, running: Method, jacobian: Any) -> Any:
        """Return the kernel of a record."""
        formulas, form = self._formulas, self.form
        if self.inline:
            stacked = self.n if form is VECTOR and self.n <= STACKED_DEGREES else 0
            make = partial(inline_kernel, formulas, form, n=stacked)
            return inlined(make, (formulas, stacked), form, self._rhs, running.jacobian)
        is_pair = self.n == 2 and form is VECTOR
        return pointer_kernel(formulas, form, jacobian is not None, is_pair)

    def _call(self, run: Run) -> tuple[int, bool]:
        """Call the kernel; return the number of steps taken, and whether the solve of the next step failed."""
        done = self._kernel(self._callbacks, self._state, self._settings, self._tally, run)
        return done, done < run.count

    def _take(
        self, count: int, every: int, u_rows: np.ndarray, v_rows: np.ndarray, cancels: tuple[Cancel, ...]
    ) -> None:
        """Call the kernel for one slice of steps after the other."""
        begin, end = self.index, self.index + count
        self.failed, self.raised_before = False, None
        while self.index < end:
            # After a call that ended within a step, the next one takes this step only: then the run may stop.
            steps, *begun = self._slices.begin(1 if self.has_begun_step else end - self.index)
            written = self.index // every - begin // every
            run = Run(self.h, self.t0, self.params, self.index, steps, every, u_rows[written:], v_rows[written:])
            try:
                done, has_failed = self._call(run)
            except BaseException:
                self.raised_before = self.index + steps
                self._go_back()
                raise
            self.seconds += self._slices.end(done, *begun)
            self.index += done
            if self.is_over:
                return
            if has_failed:
                if not self._fall_back():
                    self.failed = True
                    return
            elif self.index < end and not self.has_begun_step and any(cancel.is_set() for cancel in cancels):
                return

    def _fall_back(self) -> bool:
        """Change to the method's fallback from here on; return whether there is one.

        A method and its fallback pass the same values from step to step.
        """
        fallback = self.method.fallback(self.n)
        if fallback is None or self.changed_at is not None or not math.isfinite(self.residual):
            return False
        state = self._state
        self._prepare(fallback)
        carried = 2 + fallback.formulas.past
        self._state[:carried] = state[:carried]
        self.changed_at = self.t
        return True

    def _save(self) -> None:
        before = self._before
        if before.running is not self.running:
            self._before = self._position()
            return
        np.copyto(before.state, self._state)
        np.copyto(before.tally, self._tally)
        before.index, before.changed_at = self.index, self.changed_at

    def _position(self) -> _Position:
        return _Position(self.index, self.running, self.changed_at, self._state.copy(), self._tally.copy())

    def _component(self, row: int) -> Any:
        return float(self._state[row]) if self.form is SCALAR else self._state[row].copy()

    def _check_rows(self, rows: np.ndarray | None, count: int) -> np.ndarray:
        if rows is None:
            rows = self._nowhere
        if not (isinstance(rows, np.ndarray) and rows.dtype == _FLOAT64 and rows.flags.carray):
            raise ValueError("u_rows and v_rows must be writeable, C-contiguous arrays of float64.")
        if rows.shape[1:] != self._nowhere.shape[1:] or len(rows) < count:
            needed = (count, *self._nowhere.shape[1:])
            raise ValueError(f"u_rows and v_rows must have at least the shape {needed}, not {rows.shape}.")
        return rows

    def _check_velocity(self, a: Any) -> None:
        """Refuse velocity="none" if another velocity changes the acceleration at the start."""
        if not self.method.ignores_velocity:
            return
        u, v = self.start
        with np.errstate(over="ignore"):
            other = v + (1.0 + np.abs(u) + np.abs(v))  # differs from v, by at least the size of u
        if np.any(self.acceleration(self.t0, u, other) != a):
            raise velocity_refused(self.method)


class _Alone:
    """A block that only one thread can be in."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("this stepper is in use: give each thread its own, made with fork().")

    def __exit__(self, *error: object) -> None:
        self._lock.release()


@dataclass
class _Position:
    """A state to which a stepper can go back."""

    index: int
    running: Method
    changed_at: float | None
    state: np.ndarray
    tally: np.ndarray
