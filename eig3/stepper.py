"""A run prepared to advance natively from where it stands."""

from __future__ import annotations

import copy
import operator
import time
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike

from .callbacks import check_callback, compile_for_own_arrays, read_only
from .checks import check_h, check_method, check_params, check_state, check_time
from .kernels.jit import SCALAR, inline_kernel, pointer_kernel
from .memory import aligned, check_workspace
from .methods import Method

_NEVER = 2**62


class Stepper:
    """Advance u'' = f(t, u, v) by as many steps as asked, writing states where asked.

    `eig3.integrate` is built on it; use it directly for co-simulation, real-time loops and timing.

    Parameters
    ----------
    rhs, u0, v0, h, params, method, inline
        As for `eig3.integrate`; `h` is used as it is.
    t0 : float
        The time of u0 and v0.

    Attributes
    ----------
    index : int
        Steps taken so far.
    seconds : float
        Time spent in the kernel, without compiling.

    Raises
    ------
    TypeError, ValueError
        For arguments `eig3.integrate` would refuse, and a right-hand side that is not finite at the start.
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
        self.params = check_params(params)
        self.method = check_method(method)
        check_workspace(self.method, np.size(u))
        self.inline = inline
        self.index = 0
        self.seconds = 0.0
        self._tally = np.zeros(4)  # as eig3.kernels describes it
        self._settings = np.array(self.method.settings, dtype=np.float64)
        self._callbacks = [check_callback(rhs, "rhs", self.form)]
        if self.method.jacobian is not None:
            self._callbacks.append(check_callback(self.method.jacobian, "jacobian", self.form))
        self._start = u, v
        with np.errstate(over="ignore"):  # what overflows here shows in the first step
            a = self._first_acceleration(u, v)
            past = self.method.module.start(u, v, a, self.h)
        if self.form is SCALAR:
            self._state = np.array([u, v, *past])
        else:
            self._state = aligned((2 + len(past) + self.method.module.scratch(u.size), u.size))
            for row, values in zip(self._state, (u, v, *past), strict=False):
                row[:] = values
        self._state_before, self._tally_before = self._state.copy(), self._tally.copy()
        self._index_before = 0
        self._nowhere = np.empty((0,) if self.form is SCALAR else (0, u.size))
        self._kernel = self._compiled_kernel()

    @property
    def t(self) -> float:
        """The time reached, t0 + index h."""
        return self.t0 + self.index * self.h

    @property
    def u(self) -> Any:
        """The displacement: a float or a copy, shape (n,)."""
        return self._component(0)

    @property
    def v(self) -> Any:
        """The velocity: a float or a copy, shape (n,)."""
        return self._component(1)

    @property
    def n_rhs(self) -> int:
        """Evaluations of the right-hand side, with the one at the start."""
        return 1 + int(self._tally[0])

    @property
    def n_iterations(self) -> int:
        """Iterations of an implicit method's solver."""
        return int(self._tally[1])

    @property
    def residual(self) -> float:
        """What a failed solve left of the equation for v; NaN where the step began with something not finite."""
        return float(self._tally[2])

    @property
    def failed_degree(self) -> int:
        """The degree of freedom in which a step that fails began with something not finite."""
        return int(self._tally[3])

    @property
    def is_finite(self) -> bool:
        """Whether u and v are finite. Once they are not, no step makes them so again."""
        return bool(np.isfinite(self._state[:2]).all())

    def advance(
        self,
        count: int,
        every: int = _NEVER,
        u_rows: np.ndarray | None = None,
        v_rows: np.ndarray | None = None,
    ) -> int:
        """Take `count` steps.

        Parameters
        ----------
        count : int
        every : int
            Write the state after each step whose index, counted from t0, is a multiple of this.
        u_rows, v_rows : ndarray, optional
            Where to write: C-contiguous float64 of shape (rows,) or (rows, n), with a row for each state written.

        Returns
        -------
        int
            Steps taken: fewer than `count` where an implicit method's solver failed; the state is then that before the
            failed step.

        Raises
        ------
        TypeError, ValueError
            For counts that are not whole numbers or are out of range, and for rows that cannot hold the states.

        Notes
        -----
        After an exception, from rhs or by Ctrl-C, the stepper stands where it stood before the call.
        """
        count, every = operator.index(count), operator.index(every)
        if count < 0 or every < 1:
            raise ValueError(f"count must not be negative and every be at least 1, not {count} and {every}.")
        rows = (self.index + count) // every - self.index // every
        u_rows, v_rows = self._check_rows(u_rows, rows), self._check_rows(v_rows, rows)
        arguments = self._arguments(count, every, u_rows, v_rows)
        np.copyto(self._state_before, self._state)
        np.copyto(self._tally_before, self._tally)
        self._index_before = self.index
        try:
            begin = time.perf_counter()
            taken = self._kernel(*arguments)
            self.seconds += time.perf_counter() - begin
            self.index += taken
        except BaseException:
            self.back()
            raise
        return taken

    def back(self) -> None:
        """Return to where the last `advance` started; `seconds` keeps what it took."""
        np.copyto(self._state, self._state_before)
        np.copyto(self._tally, self._tally_before)
        self.index = self._index_before

    def fork(self) -> Stepper:
        """An independent stepper that stands at the same state."""
        other = copy.copy(self)
        other._state, other._tally = aligned(self._state.shape), self._tally.copy()
        np.copyto(other._state, self._state)
        other._state_before, other._tally_before = self._state_before.copy(), self._tally_before.copy()
        return other

    def restarted(self, h: float) -> Stepper:
        """A new stepper at the start, with another step."""
        options: dict[str, Any] = {"t0": self.t0, "params": self.params, "method": self.method, "inline": self.inline}
        return Stepper(self._callbacks[0], *self._start, h=h, **options)

    def acceleration(self, t: float, u: Any, v: Any) -> Any:
        """f(t, u, v): a float, or a new array of shape (n,)."""
        rhs, given = self._callbacks[0], (read_only(u), read_only(v), read_only(self.params))
        if self.form is SCALAR:
            return rhs(t, *given)
        a = np.full(u.size, np.nan)  # an entry that rhs forgets to write shows as not finite
        rhs(t, *given, a)
        return a

    def _component(self, row: int) -> Any:
        return float(self._state[row]) if self.form is SCALAR else self._state[row].copy()

    def _arguments(self, count: int, every: int, u_rows: np.ndarray, v_rows: np.ndarray) -> tuple:
        run = (self.h, self.t0, self.params, self.index, count, every, u_rows, v_rows)
        return *self._callbacks, self._state, self._settings, self._tally, run

    def _check_rows(self, rows: np.ndarray | None, count: int) -> np.ndarray:
        if rows is None:
            rows = self._nowhere
        if not (isinstance(rows, np.ndarray) and rows.dtype == np.float64 and rows.flags.carray):
            raise ValueError("u_rows and v_rows must be writeable, C-contiguous arrays of float64.")
        if rows.shape[1:] != self._nowhere.shape[1:] or len(rows) < count:
            needed = (count, *self._nowhere.shape[1:])
            raise ValueError(f"u_rows and v_rows must have shape {needed} at least, not {rows.shape}.")
        return rows

    def _compiled_kernel(self) -> Any:
        function = self.method.function(self.form)
        arguments = self._arguments(0, _NEVER, self._nowhere, self._nowhere)
        if self.inline:
            for callback, kind in zip(self._callbacks, ("rhs", "jacobian"), strict=False):
                compile_for_own_arrays(callback, kind, self.form)
            kernel = inline_kernel(function)
            kernel.compile(tuple(numba.typeof(argument) for argument in arguments))
        else:
            kernel = pointer_kernel(function, self.form, self.method.jacobian is not None)
        kernel(*arguments)  # no steps: resolves the addresses of the callbacks before anything is timed
        return kernel

    def _first_acceleration(self, u: Any, v: Any) -> Any:
        a = self.acceleration(self.t0, u, v)
        bad = np.flatnonzero(~np.isfinite(a))
        if bad.size:
            raise ValueError(
                f"rhs gives {np.atleast_1d(a)[bad[0]]} for degree of freedom {bad[0]} at the start; "
                "it must give a finite acceleration for every degree of freedom, a[j] in the vector form."
            )
        other = v + (1.0 + np.abs(u) + np.abs(v))  # differs from v, and by as much as u gives
        if self.method.ignores_velocity and np.any(self.acceleration(self.t0, u, other) != a):
            raise ValueError("velocity='none' needs a rhs that ignores v, and this one does not; leave it out.")
        return a
