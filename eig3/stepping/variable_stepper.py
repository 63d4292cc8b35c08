"""A run with tolerances that advances in compiled code."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..functions.guard import guarded
from ..functions.inlining import inlined
from ..kernels.loops import variable
from ..kernels.loops.fixed import STACKED_DEGREES
from ..kernels.loops.formulas import variable_formulas
from ..kernels.loops.observe import Observation
from ..kernels.loops.pair import U_MOST, V_MOST, A, U, V
from ..kernels.loops.variable import least_size
from ..kernels.protocol import (
    BY_SPAN,
    ERROR,
    REJECTED,
    SILENT_END,
    SILENT_STEP,
    STEP,
    STEP_BEFORE,
    TIME,
    U_SIZE,
    V_SIZE,
    Span,
)
from ..methods import Method
from ..result.extension import states_between
from .march import March, Rows
from .system import Kernel, System
from .tolerances import NO_POINTS, Tolerances, longest_way

_STANDING = 1e-12  # a smaller motion, relative to the largest motion, is round-off


class VariableStepper(March):
    """Advance u'' = f(t, u, v) with tolerances; `params` come from `guarded`, and `times` are the times of t_eval."""

    n_iterations = 0
    notes: tuple[str, ...] = ()
    rows_before_end: int | None = None  # the rows that were written before the last step; None before `shorten`
    _before_end: dict[str, Any] | None = None  # the return value of `kept` before the last step

    def __init__(
        self,
        system: System,
        t_span: tuple[float, float],
        u: Any,
        v: Any,
        params: np.ndarray,
        tolerances: Tolerances,
        times: np.ndarray | None = None,
    ) -> None:
        self.tolerances = tolerances
        self._way = longest_way(system.cutoffs, tolerances, params) if system.cutoffs else NO_POINTS
        t0, self.t_end = t_span
        a = self._begin(system, t0, u, v, params, times)
        self.state[U], self.state[V], self.state[A] = u, v, a
        self.counters[ERROR], self.counters[STEP] = 1.0, min(tolerances.h_first, tolerances.h_max)
        if self.look:
            self.look.look_within(self.kernel.formulas, tolerances.rtol)

    def _work_rows(self) -> int:
        return self.kernel.formulas.work_rows

    def _new_kernel(self, method: Method) -> Kernel:
        return _kernel(self.system, method.variable, self.n)

    @property
    def t(self) -> float:
        """The time reached."""
        return float(self.counters[TIME])

    @property
    def h(self) -> float:  # type: ignore[override]
        """The length of the last step."""
        return float(self.counters[STEP_BEFORE])

    @property
    def mean_step(self) -> float:
        return (self.t - self.t0) / max(1, self.index)

    @property
    def n_rejected(self) -> int:
        """Number of steps that were repeated with a shorter step."""
        return int(self.counters[REJECTED])

    @property
    def follows_span(self) -> bool:
        """Whether a run to another end would have taken other steps, not only another last step."""
        return self.counters[BY_SPAN] != 0

    @property
    def silence(self) -> tuple[float, float]:
        """The longest step in which no force acted although rhs reads t, or 0, and the time of its end."""
        return float(self.counters[SILENT_STEP]), float(self.counters[SILENT_END])

    @property
    def held(self) -> float:
        """The longest way of a point in a step if it limits the last whole step, or 0."""
        points, reach = self._way
        last = self.before_end()
        return reach if points and last.h * np.abs(last.v[:points]).max() > reach / 2 else 0.0

    @property
    def tiny(self) -> list[str]:
        """What moves, but by less than ten times the allowed error of a step."""
        tolerances, found = self.tolerances, []
        of_z = np.isinf(tolerances.atol[0])
        sizes = np.where(self.state[V_MOST] > 0, self.state[U_MOST], 0.0), self.state[V_MOST]  # zeros with atol
        for name, each, largest, are in (
            ("u", sizes[0], self.counters[U_SIZE], ~of_z),
            ("z", sizes[1], self.counters[V_SIZE], of_z & np.isfinite(tolerances.atol[1])),
        ):
            tolerance = tolerances.rtol * least_size(tolerances.rtol) * largest
            small = (each[are] > _STANDING * largest) & (each[are] < 10 * tolerance)
            found += [f"{name}[{j}]" for j in np.flatnonzero(small)]
        return found

    @property
    def states_between(self) -> Any:
        """A function that returns u and v at some times, from a history with the states after all steps.

        It is None for a method without a continuous extension, and for a right-hand side with a history.
        """
        if not self.kernel.formulas.dense_evaluations or self.system.history:
            return None
        return partial(states_between, self.system.callback, self.p, self.system.method.variable)

    def steps(self, count: int, every: int, row: int, rows: Any) -> Span:
        tolerances = self.tolerances
        return Span(
            self.t0,
            self.t_end,
            self.p,
            self.index,
            count,
            every,
            row,
            tolerances.h_max,
            tolerances.rtol,
            tolerances.atol,
            int(tolerances.is_relative),
            int(self._before_end is not None),
            int(self.system.callback.reads_time),
            *self._way,
            *rows,
        )

    def _has_room(self, row: int, rows: Rows) -> bool:
        return not len(rows.t) or row + 2 <= len(rows.t)

    def shorten(self, rows: int) -> None:
        """Shorten the next step to the end of the span, and keep the state before it and the number of rows so far."""
        self._before_end, self.rows_before_end = self.kept(), rows

    def before_end(self) -> VariableStepper:
        """Return an independent stepper from which a run to a later end continues: before a shortened last step."""
        other = self.fork()
        if self._before_end:
            other.restore(self._before_end)
        other._before_end = other.rows_before_end = None
        return other

    def restarted(self, t_end: float, times: np.ndarray | None) -> VariableStepper:
        """Return an independent stepper at the start, for a run to another end."""
        start = *self.start, guarded(self.p)
        return VariableStepper(self.system, (self.t0, t_end), *start, self.tolerances, times)


def _kernel(system: System, module: str, n: int) -> Kernel:
    """Compile or load the kernel of a method for n degrees of freedom."""
    formulas, form, parts = variable_formulas(module), system.form, system.parts
    if system.inline:
        literal = n if n <= STACKED_DEGREES else 0
        compiled = inlined(partial(_inline, module, form, n), (module, literal), form, system.rhs)
        call = variable.observing(compiled, module, form, n, parts)
    else:
        call = variable.kernel(module, form, 0 if system.constrained_step else n, parts=parts)
    callbacks, rows = (system.callback.address, None), formulas.rows
    return Kernel(system.method, formulas, rows, rows, call, callbacks, Observation(), (module, n, system.inline))


def _inline(module: str, form: Any, n: int, rhs: Any, jacobian: None, quantities: tuple) -> Any:
    return variable.inline_kernel(module, form, n, rhs)
