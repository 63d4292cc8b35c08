"""A run with a fixed step that advances by any number of steps in compiled code."""

from __future__ import annotations

import math
import operator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback
from ..functions.checks import (
    check_cancel,
    check_flag,
    check_h,
    check_method,
    check_params,
    check_state,
    check_time,
)
from ..functions.guard import guarded
from ..functions.inlining import inlined
from ..functions.named import Parameters, named
from ..functions.rules import Rules
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.loops import fixed
from ..kernels.protocol import ANEW, DEGREE, EVALUATIONS, FAILED, ITERATIONS, RESIDUAL, SCALAR, TIME, Steps
from ..keywords import with_suggestions
from ..methods import Method
from ..result.memory import check_workspace
from .march import Cancel, March, Rows
from .run_options import NEVER, RunOptions
from .slices import Slices
from .system import Kernel, System

_SMALL = 1e100  # an acceleration with which no past value overflows
_FLOAT64 = np.dtype(np.float64)
# At the end of a slice, a kernel moves values between rows, which takes about as long as a step of a large system.
# After a multiple of the period in which the rows rotate, nothing must be moved.
_LARGE = 1000  # least degrees of freedom for slices of such multiples


class Stepper(March):
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
        The parameters p, which are read-only. Between two calls, assign all values anew, in the form that
        `eig3.integrate` takes: the method then starts anew, because f may jump.
    method : Method
        The requested method.
    running : Method
        The method of the steps: `method` with every option "auto" decided.
    changed_at : float or None
        The time after which the fallback of `method` is used, because the solve of a step did not converge.
    index : int
        Number of steps taken.
    failed : bool
        Whether the solve of an implicit step failed in the last `advance`. The stepper is then at the state before this
        step.
    seconds : float
        Time spent in the kernel, s, without compilation.

    Raises
    ------
    TypeError, ValueError
        If `eig3.integrate` would refuse the arguments, or the right-hand side is not finite at the start.
    MemoryError
        If the matrix of an implicit method does not fit in memory.
    RuntimeError
        If two threads use the stepper at the same time; raised in the second thread.
    """

    middle_sizes: tuple[float, float] | None = None  # the sizes in the middle of a short run that starts at rest

    @with_suggestions()
    def __init__(
        self,
        rhs: Any,
        u0: ArrayLike,
        v0: ArrayLike,
        *,
        h: float,
        t0: float = 0.0,
        params: Any = (),
        method: str | Method = "eig3",
        inline: bool = False,
    ) -> None:
        h, t0 = check_h(h), check_time(t0, "t0")
        u, v, form = check_state(u0, v0)
        params, record = named(params), check_method(method)
        if isinstance(params, Parameters):
            rhs, record = params.layout.bind(rhs), params.layout.bind_method(record)
        system = System(rhs, form, RunOptions(method=record, inline=check_flag(inline, "inline")))
        p = guarded(check_params(params))
        if rules := Rules(system.events, system.event_table, system.project):
            u, v = rules.starts(u.size, (t0, t0), u, v, p)
        vars(self).update(vars(Stepper.of(system, t0, h, u, v, p)))

    @classmethod
    def of(
        cls, system: System, t0: float, h: float, u: Any, v: Any, params: np.ndarray, times: np.ndarray | None = None
    ) -> Stepper:
        """Return a stepper at the start of a system, from checked arguments; `params` come from `guarded`."""
        self = object.__new__(cls)
        self.h = h
        a = self._begin(system, t0, u, v, params, times)
        if self.first_sizes[2] < _SMALL:
            past = self.kernel.formulas.start(u, v, a, h)
        else:
            with np.errstate(over="ignore"):  # a past value that overflows makes the first step non-finite
                past = self.kernel.formulas.start(u, v, a, h)
        self.state[0], self.state[1] = u, v
        for k, values in enumerate(past):
            self.state[2 + k] = values
        return self

    def _start_anew(self) -> None:
        u, v = self.u, self.v
        past = self.kernel.formulas.start(u, v, self.acceleration(self.t, u, v), self.h)
        for k, values in enumerate(past):
            self.state[2 + k] = values
        self.counters[EVALUATIONS] += 1
        self.counters[ANEW] = self.index

    def _work_rows(self) -> int:
        return fixed.work_rows(self.system.method.formulas, self.system.method.order)

    def _new_kernel(self, method: Method) -> Kernel:
        return _kernel(self.system, method, self.n)

    def _new_slices(self) -> Slices:
        return Slices(self.pace, self.kernel.formulas.turn if self.n >= _LARGE else 1)

    @property
    def t(self) -> float:
        """The current time: t0 + index h, or the time of the event that ended the run."""
        return float(self.counters[TIME]) if self.is_over else self.t0 + self.index * self.h

    @property
    def is_within_step(self) -> bool:
        """Whether an event ended the run between the ends of two steps."""
        return self.is_over and self.t > self.t0 + self.index * self.h

    @property
    def failed(self) -> bool:
        return self.ended == FAILED

    @property
    def n_iterations(self) -> int:
        """Number of iterations of an implicit method's solver."""
        return int(self.counters[ITERATIONS])

    @property
    def residual(self) -> float:
        """The residual of the last failed solve for v; NaN if a value was not finite at its first iteration."""
        return float(self.counters[RESIDUAL])

    @property
    def failed_degree(self) -> int:
        """The degree of freedom in which the last failed solve found a value that is not finite."""
        return int(self.counters[DEGREE])

    @property
    def sizes(self) -> tuple[float, float]:
        """The largest |u| and the largest |v|."""
        u, v = np.maximum.reduce(np.abs(self.state[:2]), axis=1).tolist()
        return u, v

    @with_suggestions()
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
            C-contiguous arrays of float64 for the written states, with at least one row for each state.
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
        After an exception in rhs, the stepper is at the state before the call. After Ctrl-C, which raises
        KeyboardInterrupt soon, it is at the last state reached.
        """
        count, every = operator.index(count), operator.index(every)
        if count < 0 or every < 1:
            raise ValueError(f"count must not be negative and every be at least 1, not {count} and {every}.")
        count = min(count, NEVER - 1 - self.index)  # no call takes this many steps
        needed = (self.index + count) // every - self.index // every
        u_rows, v_rows = self._check_rows(u_rows, needed), self._check_rows(v_rows, needed)
        first = self.index
        interrupt = DeferredInterrupt()  # never set within an outer block, which uses `cancel` instead
        cancels = (interrupt,) if cancel is None else (interrupt, check_cancel(cancel))
        with interrupt, self._alone():
            self.take(count, every, 0, Rows(_NONE, _NONE, u_rows, v_rows), cancels)
        return self.index - first

    def restarted(self, h: float) -> Stepper:
        """Return a new stepper at t0, u0 and v0, with the step h, and the same events."""
        return Stepper.of(self.system, self.t0, h, *self.start, guarded(self.p))

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

    def steps(self, count: int, every: int, row: int, rows: Rows) -> Steps:
        return Steps(self.h, self.t0, self.p, self.index, count, every, row, rows[2], rows[3])

    def _goes_on_after(self, ended: int) -> bool:
        """Change to the fallback of the method; return whether there is one.

        A method and its fallback carry the same values from step to step.
        """
        fallback = self.method.fallback(self.n) if ended == FAILED else None
        if fallback is None or self.changed_at is not None or not math.isfinite(self.residual):
            return False
        state, carried = self.state, self.kernel.carried
        self._use(self._compiled(fallback))
        self.state[:carried] = state[:carried]
        self.changed_at = self.t
        return True

    def _check_rows(self, rows: np.ndarray | None, count: int) -> np.ndarray:
        shape = () if self.form is SCALAR else (self.n,)
        if rows is None:
            rows = np.empty((0, *shape))
        if not (isinstance(rows, np.ndarray) and rows.dtype == _FLOAT64 and rows.flags.carray):
            raise ValueError("u_rows and v_rows must be writeable, C-contiguous arrays of float64.")
        if rows.shape[1:] != shape or len(rows) < count:
            raise ValueError(f"u_rows and v_rows must have at least the shape {(count, *shape)}, not {rows.shape}.")
        return rows.reshape(-1, self.n)


_NONE = np.empty(0)


def _kernel(system: System, method: Method, n: int) -> Kernel:
    """Compile or load the kernel of a method for n degrees of freedom."""
    running = method.for_force(system.callback.reads_velocity, n)
    stepping = running.with_constraints() if system.constrained_step else running
    formulas, form = stepping.formulas, system.form
    check_workspace(stepping, n)
    second, address = stepping.second, system.constrained_step if stepping.second else None
    if running.jacobian:
        second, address = "jacobian", check_callback(running.jacobian, "jacobian", form).address
    settings = np.array(stepping.settings, dtype=np.float64)
    order, looks = system.method.order, system.looks
    if system.inline:
        make = partial(fixed.inline_kernel, formulas, order, form, n, looks=looks)
        literal = n if n <= fixed.STACKED_DEGREES else 0
        call = inlined(make, (formulas, literal, looks), form, system.rhs, running.jacobian, system.followed.quantities)
        address = None  # the Jacobian is inlined too
    else:
        call = fixed.kernel(formulas, order, form, n, looks=looks, second=second)
    callbacks, rows = (system.callback.address, address), (formulas.state_rows(n), 2 + formulas.past)
    return Kernel(running, formulas, *rows, call, callbacks, settings, (formulas, n, system.inline))
