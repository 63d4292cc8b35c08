"""A run with tolerances that advances in compiled code."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.accelerations import accelerations
from ..functions.callbacks import check_callback
from ..functions.checks import check_flag, check_index, check_params, check_state, reals
from ..functions.guard import first_acceleration, guarded
from ..functions.inlining import inlined
from ..kernels.loops.fixed import STACKED_DEGREES
from ..kernels.loops.pair import U_MOST, A, U, V
from ..kernels.loops.variable import FULL, GOING, WORK, inline_variable_kernel, least_size, variable_kernel
from ..kernels.protocol import (
    BY_SPAN,
    ENDED_BY,
    ERROR,
    EVALUATIONS,
    EVENT_VALUES,
    EVENTS,
    REJECTED,
    SCALAR,
    SILENT_END,
    SILENT_STEP,
    STEP,
    STEP_BEFORE,
    TIME,
    U_SIZE,
    Span,
)
from ..methods import Method
from ..result.extension import states_between
from ..result.growing import Rows
from ..result.memory import aligned
from .slices import Slices
from .stepper import Cancel
from .tolerances import Tolerances
from .watching import Watching

_STANDING = 1e-12  # a motion of this part of the largest one is round-off


class VariableStepper:
    """Advance u'' = f(t, u, v) with steps that follow from tolerances.

    Attributes
    ----------
    index : int
        Number of steps taken.
    ended : int
        How the last call of the kernel ended: an outcome of `eig3.kernels.loops.events` or of
        `eig3.kernels.loops.variable`.
    raised_before : int or None
        The step index before which rhs raised an exception in the last `advance`; None if it did not.
    """

    def __init__(
        self,
        rhs: Any,
        t_span: tuple[float, float],
        u0: ArrayLike,
        v0: ArrayLike,
        *,
        params: ArrayLike,
        method: Method,
        tolerances: Tolerances,
        inline: bool,
        events: Any,
        t_eval: ArrayLike | None,
    ) -> None:
        u, v, self.form = check_state(u0, v0)
        self.start, self.inline = (u, v), inline
        self.params = guarded(check_params(params))
        self.method, self.tolerances = method, tolerances
        self.t0, self.t_end = t_span
        self.n = 1 if self.form is SCALAR else u.size
        self._callback = check_callback(rhs, "rhs", self.form)
        a = first_acceleration(self._callback, self.form, self.t0, u, v, self.params)
        self.watching = Watching(events, t_eval, self.form, (u, v), t_span, self.params, WORK)
        self._prepare(rhs, inline)
        self._begin(u, v, a)

    def _begin(self, u: Any, v: Any, a: Any) -> None:
        self._state = aligned((self._formulas.rows, self.n))
        self._state[U], self._state[V], self._state[A] = u, v, a
        self._tally = np.zeros(EVENTS + EVENT_VALUES * len(self.watching.events))
        self._tally[TIME], self._tally[ERROR], self._tally[STEP] = (
            self.t0,
            1.0,
            min(self.tolerances.h_first, self.tolerances.h_max),
        )
        self.watching.begin(self._tally, self.t0, u, v)
        self.index, self.ended, self.seconds = 0, GOING, 0.0
        self.raised_before: int | None = None
        self._may_shorten = False

    def _prepare(self, rhs: Any, inline: bool) -> None:
        n = self.n
        self._formulas = importlib.import_module(f"eig3.kernels.methods.{self.method.variable}").variable
        self._pace_key = self.method.variable, n, inline
        self._slices = Slices(self.pace)
        if check_flag(inline, "inline"):
            literal = n if n <= STACKED_DEGREES else 0
            make = partial(inline_variable_kernel, self.method.variable, self.form, literal)
            self._callbacks: tuple = ()
            self._kernel = inlined(make, (self.method.variable, literal, "variable"), self.form, rhs)
        else:
            self._callbacks = (self._callback.address,)
            self._kernel = variable_kernel(self.method.variable, self.form, n if n <= 2 else 0)

    @property
    def order(self) -> int:
        """The power of the step with which its estimated error grows."""
        return self._formulas.order

    @property
    def t(self) -> float:
        """The time reached."""
        return float(self._tally[TIME])

    @property
    def u(self) -> Any:
        """The displacement: a float, or a new array of shape (n,)."""
        return self._component(U)

    @property
    def v(self) -> Any:
        """The velocity: a float, or a new array of shape (n,)."""
        return self._component(V)

    @property
    def n_rhs(self) -> int:
        """Number of evaluations of the right-hand side, including the one at the start."""
        return 1 + int(self._tally[EVALUATIONS])

    @property
    def n_rejected(self) -> int:
        """Number of steps that were repeated with a shorter step."""
        return int(self._tally[REJECTED])

    @property
    def h_before(self) -> float:
        """The length of the last step."""
        return float(self._tally[STEP_BEFORE])

    @property
    def follows_span(self) -> bool:
        """Whether a run to another end would have taken other steps, not only another last one."""
        return self._tally[BY_SPAN] != 0

    @property
    def silence(self) -> tuple[float, float]:
        """The longest step in which no force acted though rhs reads t, or 0, and the time of its end."""
        return float(self._tally[SILENT_STEP]), float(self._tally[SILENT_END])

    @property
    def tiny(self) -> np.ndarray:
        """The degrees of freedom that move, but by less than ten times the error that a step may have."""
        rtol, largest, sizes = self.tolerances.rtol, self._tally[U_SIZE], self._state[U_MOST]  # zeros with atol
        tolerance = rtol * least_size(rtol) * largest
        return np.flatnonzero((sizes > _STANDING * largest) & (sizes < 10 * tolerance))

    def finish(self) -> None:
        """Write the state at the event that ended the run at the wanted times that differ from it by round-off only."""
        self.watching.finish(self._tally, self.t, self.h_before, self.u, self.v)

    def wanted_rows(self) -> Rows | None:
        """Return the states at the wanted times so far; None if no times were given."""
        return self.watching.rows(self._tally)

    @property
    def ended_by(self) -> str:
        """The name of the event that ended the run."""
        return self.watching.name(int(self._tally[ENDED_BY]))

    @property
    def accelerations(self) -> Any:
        """A function that evaluates f(t_i, u_i, v_i) at rows of states, and does not keep this stepper."""
        return partial(accelerations, self._callback, self.params)

    @property
    def states_between(self) -> Any:
        """A function that returns u and v at some times, from a history with the states after all steps of RK8."""
        return partial(states_between, self._callback, self.params)

    @property
    def pace(self) -> float | None:
        """Seconds per step of the last run with this right-hand side and kernel; None before the first run."""
        return self._callback.pace.get(self._pace_key)

    def note_pace(self) -> None:
        """Store the measured time per step for later runs."""
        if self.index:
            self._callback.pace[self._pace_key] = self.seconds / self.index

    def advance(self, count: int, every: int, rows: Rows, dense: np.ndarray, stop: Cancel) -> Rows:
        """Take at most `count` steps, or less if `stop` is set, and return the rows with every `every`-th state.

        If `dense` has rows, and every state is written, the dense output of each step is written to the row of its end.
        After an exception, the stepper is at its state before the call.
        """
        before = self.index, self._state.copy(), self._tally.copy(), self.watching.n_found
        self.ended, self.raised_before = GOING, None
        try:
            return rows.at(slice(self._take(count, every, rows, dense, stop)))
        except BaseException:
            self.index, self._state[:], self._tally[:], n_found = before
            self.watching.forget_from(n_found)
            raise

    def _take(self, count: int, every: int, rows: Rows, dense: np.ndarray, stop: Cancel) -> int:
        """Call the kernel for one slice of steps after the other, and return the number of rows that are written."""
        end, written, capacity = self.index + count, 0, len(rows.t)
        while self.index < end and self.ended == GOING:
            if capacity and written + 2 > capacity:  # a kernel without rows would write none, and go on
                self.ended = FULL
                break
            steps, *begun = self._slices.begin(end - self.index)
            span = self._span(steps, every, rows.at(slice(written, None)), dense[written:])
            try:
                taken, new, self.ended = self._kernel(
                    self._callbacks, self._state, self._tally, span, self.watching.watch
                )
            except BaseException:
                self.raised_before = self.index + steps
                raise
            self.seconds += self._slices.end(taken, *begun)
            self.index, written = self.index + taken, written + new
            self.watching.collect(self._tally)
            if stop.is_set():
                break
        return written

    def _span(self, count: int, every: int, rows: Rows, dense: np.ndarray) -> Span:
        tolerances = self.tolerances
        return Span(
            self.t0,
            self.t_end,
            self.params,
            self.index,
            count,
            every,
            tolerances.h_max,
            tolerances.rtol,
            tolerances.atol,
            int(tolerances.is_relative),
            int(self._may_shorten),
            int(self._callback.reads_time),
            *rows,
            dense,
        )

    def present(self, h: float) -> Rows:
        """Return the present state as a row, with the step h that led there."""
        return Rows(np.array([self.t]), np.array([h]), *(self._state[row : row + 1].copy() for row in (U, V)))

    def shorten(self) -> None:
        """Allow the last step to be shortened, so that it ends at the end of the span."""
        self._may_shorten = True

    def fork(self) -> VariableStepper:
        """Return an independent stepper at the same state."""
        other = copy.copy(self)
        other._slices = copy.copy(self._slices)
        other._state, other._tally = aligned(self._state.shape), self._tally.copy()
        np.copyto(other._state, self._state)
        other.watching = self.watching.fork()
        return other

    def kept(self) -> dict[str, Any]:
        """Return what this stepper needs, besides its arguments, to go on: numbers and arrays."""
        numbers = {"index": self.index, "seconds": self.seconds}
        return {**numbers, "state": self._state.copy(), "tally": self._tally.copy()}

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Become the stepper that has returned `kept`; it has the same arguments.

        Raises
        ------
        ValueError
            If `kept` is that of another stepper.
        """
        state, tally = (reals(kept[name], name) for name in ("state", "tally"))
        if state.shape != self._state.shape or tally.shape != self._tally.shape:
            raise ValueError(f"a state of the shape {state.shape} does not belong to {self.method!r}.")
        counts = tally[[EVALUATIONS, REJECTED, TIME]]
        if not (np.isfinite(counts).all() and (counts[:2] >= 0).all()):
            raise ValueError(f"{counts} are not the counts and the time of a stepper.")
        self._state[:], self._tally[:] = state, tally
        self.watching.restore(self._tally)
        self.index, self.seconds = check_index(kept["index"]), float(kept["seconds"])

    def extended(self, t_end: float) -> VariableStepper:
        """Return an independent stepper at the same state, for a run to a later end."""
        watching = self.watching.extended(self.t0, t_end)
        other = self.fork()
        other.t_end, other.watching, other._may_shorten = t_end, watching, False
        return other

    def restarted(self, t_end: float) -> VariableStepper:
        """Return an independent stepper at the start, for a run to another end."""
        other = copy.copy(self)
        other._slices = copy.copy(self._slices)
        other.t_end, other.watching = t_end, self.watching.extended(self.t0, t_end)
        other.watching.forget_from(0)
        u, v = self.start
        other._begin(u, v, first_acceleration(self._callback, self.form, self.t0, u, v, self.params))
        return other

    def _component(self, row: int) -> Any:
        return float(self._state[row, 0]) if self.form is SCALAR else self._state[row].copy()
