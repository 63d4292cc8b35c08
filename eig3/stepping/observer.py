"""The observer of a run in each step: events, times of t_eval, invariants and outputs."""

from __future__ import annotations

import contextlib
import copy
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals
from ..functions.extremes import Extremes
from ..functions.first_order import flat
from ..functions.guard import beyond, guarded
from ..kernels.loops.zeros import NEAR
from ..kernels.protocol import (
    COLUMN,
    DUE,
    EVENT_VALUES,
    EVENTS,
    HIGH,
    LOGGED,
    NEXT,
    NOT_FINITE,
    OUT,
    PART_END,
    ROWS,
    SCALAR,
    SPACING,
    T_HIGH,
    T_LOW,
    Follow,
    Look,
    Watch,
    Within,
)
from ..result.occurrences import Occurrences
from .followed import n_invariants, spacing_of
from .samples import within_steps
from .system import System

_LOG_ROWS = 32  # least number of occurrences of each event in the log
_LOG_VALUES = 2**15  # values in the log of occurrences, after which the kernel returns
_NO_TIMES = np.empty(0)


def check_times(t_eval: ArrayLike | None, t0: float, t1: float) -> np.ndarray | None:
    """Return the times of t_eval as an array, or None."""
    if t_eval is None:
        return None
    times = reals(t_eval, "t_eval")
    if times.ndim != 1 or not times.size:
        raise ValueError(f"t_eval must be a 1-D array of at least one time, not of the shape {times.shape}.")
    is_outside = ~((t0 <= times) & (times <= t1))
    if is_outside.any():
        span = f"from {float(t0)!r} to {float(t1)!r}, not at {float(times[is_outside][0])!r}"
        raise ValueError(f"t_eval must lie within t_span, {span}: leave this time out, or clip it if it is round-off.")
    if not (np.diff(times) > 0).all():
        raise ValueError("t_eval must increase: sort the times, and give each of them once.")
    return times


def further_times(times: np.ndarray | None, t_eval: ArrayLike | None, end: float, t_end: float) -> np.ndarray | None:
    """Return the times of a run that continues from `end` to `t_end`: the times so far, and the new times `t_eval`."""
    if t_eval is None:
        return times
    if times is None:
        raise ValueError("t_eval belongs to a run with t_eval: this one saves its states by save_every.")
    further: Any = check_times(t_eval, end, t_end)
    if further[0] <= max(end, times[-1]):
        raise ValueError(f"t_eval must begin after the end of the run at t = {end!r}, and after its own last time.")
    return np.concatenate([times, further])


class Observer:
    """The observer of one run, of n degrees of freedom.

    The kernel needs `work_rows` rows of scratch for events and for `times`, the times of t_eval. All values of the
    invariants and outputs that change during the run are in `numbers`; the other arrays are views of it.
    """

    def __init__(self, system: System, times: np.ndarray | None, n: int, work_rows: int) -> None:
        self.system, self.followed, self.times, self._n = system, system.followed, times, n
        self._is_scalar = system.form is SCALAR
        count = len(system.event_table)
        log = np.empty((count and max(_LOG_ROWS * count, _LOG_VALUES // (2 + 4 * n)), 2 + 4 * n))
        work, nothing = np.empty((work_rows, n)), np.empty((0, n))
        wanted = _NO_TIMES if times is None else times
        self.watch = Watch(system.event_table, log, wanted, _NO_TIMES, nothing, nothing, work, np.empty((4, count)))
        self._found: list[np.ndarray] = []
        self.n_found = 0  # occurrences so far, without occurrences in the log
        self._within: Within | None = None
        self._use_numbers(None)

    def _use_numbers(self, numbers: np.ndarray | None) -> None:
        self._table = self.followed.table.copy()
        self._output_rows: Mapping[str, np.ndarray] = {}
        self.numbers, arrays = self.followed.arrays(self._n, numbers)
        self._widest, self.steps, self._start, self._before, self._out, self.parts, self.forward, self.most = arrays

    @property
    def arguments(self) -> Look:
        """The argument of the kernel."""
        arrays = self._table, self._out, self._widest, self.steps, self.parts, self.forward, self.most
        follow = Follow(*arrays, len(self.followed.invariants), self.followed.advance, self.followed.project)
        return Look(self.watch, follow, self._within)

    def begin(self, counters: np.ndarray, t0: float, u: Any, v: Any, params: np.ndarray) -> None:
        """Observe the start: write the signs of g, clear the last reset, and evaluate the quantities.

        Raises
        ------
        ValueError
            If `apply` of an event writes beyond the end of u or v, or if a quantity does not write all of its values,
            or writes beyond them.
        """
        counters[PART_END] = counters[DUE] = 1
        counters[SPACING] = spacing_of(self.followed.functions.invariants_every)
        values = counters[EVENTS:].reshape(-1, EVENT_VALUES)
        values[:, 0], values[:, 1], values[:, 2:] = 0.0, -np.inf, 0.0
        for k, (name, (g, apply)) in enumerate(zip(self.system.events, self.system.event_callbacks, strict=True)):
            values[k, 0] = g.call(t0, u, v, params)
            if apply and not self._is_scalar:
                _check_within(apply, name, t0, (u, v), params)
        if not self.followed.quantities:
            return
        self._out.fill(np.nan)
        for k, quantity in enumerate(self.followed.quantities):
            quantity.at_start(t0, u, v, params, self._values(k))
            self._start[self._columns(k)] = self._values(k)
        self._before[:] = self._start
        self._widest[T_LOW] = self._widest[T_HIGH] = t0
        for lowest, highest in (self._widest[: HIGH + 1], self.steps, self.parts[0]):
            lowest[:] = highest[:] = self._start

    def look_within(self, formulas: Any, rtol: float) -> None:
        """Also find the extremes of quantities within steps of variable length.

        A nearly constant invariant takes few evaluations: relative changes within a step below rtol are ignored.
        """
        followed, n = self.followed, self._n
        self._within = None if followed.quantities else followed.idle_within.get(n)
        if self._within is None:
            floors = np.zeros(len(followed.quantities))
            floors[: len(followed.invariants)] = rtol
            self._formulas, self._rtol = formulas, rtol
            self._within = within_steps(self._before, n, formulas, floors)
        if not followed.quantities:
            followed.idle_within[n] = self._within

    def save_wanted(self, rows: Mapping[str, np.ndarray], n: int) -> None:
        """Make the kernel write the states at the times of t_eval to these rows: u, v and, if present, steps."""
        u, v = rows["u"].reshape(-1, n), rows["v"].reshape(-1, n)
        h = rows["steps"].ravel() if "steps" in rows else np.empty(len(u))
        self.watch = self.watch._replace(h_rows=h, u_rows=u, v_rows=v)

    def save_outputs(self, rows: Mapping[str, np.ndarray]) -> None:
        """Make the kernel write the values of outputs in saved states to these arrays, of shape (rows, width)."""
        self._output_rows = rows
        for name, array in rows.items():
            self._table[self.followed.outputs[name], ROWS] = array.__array_interface__["data"][0]

    def want(self, times: np.ndarray | None) -> None:
        """Set the times of t_eval, for a run that continues."""
        self.times = times
        self.watch = self.watch._replace(times=_NO_TIMES if times is None else times)

    def fork(self) -> Observer:
        """Return an independent copy, which saves nothing."""
        other, watch = copy.copy(self), self.watch
        own = {name: getattr(watch, name).copy() for name in ("log", "work", "search")}
        none = {"times": _NO_TIMES, "h_rows": _NO_TIMES, "u_rows": watch.u_rows[:0], "v_rows": watch.v_rows[:0]}
        other.watch, other._found = watch._replace(**own, **none), list(self._found)
        other.times = None
        if self.followed.quantities:
            other._use_numbers(self.numbers.copy())
            if self._within is not None:
                other.look_within(self._formulas, self._rtol)
        return other

    def checked(self, numbers: Any) -> np.ndarray:
        """Return numbers from a file, if their shape matches this observer."""
        numbers = reals(numbers, "the numbers of quantities")
        if numbers.shape != self.numbers.shape:
            raise ValueError("the numbers of the invariants and outputs have another shape.")
        return numbers

    def check(self) -> None:
        """Raise a ValueError if a quantity has written beyond its values."""
        self.followed.check(self._out)

    def collect(self, counters: np.ndarray) -> None:
        """Take the occurrences out of the log."""
        logged = int(counters[LOGGED])
        if logged:
            self._found.append(self.watch.log[:logged].copy())
            self.n_found += logged
            counters[LOGGED] = 0

    def forget_from(self, n_found: int) -> None:
        """Discard the occurrences after the first `n_found`."""
        if n_found < self.n_found:
            self._found, self.n_found = [np.concatenate(self._found)[:n_found]], n_found

    def finish(self, stepper: Any, t: float) -> None:
        """Write the state at t, the end of the run, at the times of t_eval that differ from t only by round-off.

        It is the state before the resets at t, if there are any.
        """
        if self.times is None:
            return
        counters, u, v = stepper.counters, stepper.u, stepper.v
        near = NEAR * math.ulp(max(abs(stepper.t0), abs(t)))
        first, last = self.times.searchsorted([t, t + near])
        some = slice(min(first, int(counters[NEXT])), last)
        for block in (found for found in self._found[-1:] if len(found)):
            row = block[min(int(np.searchsorted(block[:, 1], t - near)), len(block) - 1)]  # in order of time
            if row[1] >= t - near:
                u, v = row[2 : 2 + self._n], row[2 + self._n : 2 + 2 * self._n]
                u, v = (u.item(), v.item()) if self._is_scalar else (u, v)
        self.watch.u_rows[some], self.watch.v_rows[some], self.watch.h_rows[some] = u, v, stepper.h
        for name, rows in self._output_rows.items() if some.start < last else ():
            rows[some] = self.followed.quantities[self.followed.outputs[name]].value(t, u, v, stepper.p)
        counters[NEXT] = max(last, int(counters[NEXT]))

    def recall(self, events: Mapping[str, Occurrences], counts: Mapping[str, int] | None = None) -> None:
        """Set the occurrences so far to the first occurrences of each event, or to all.

        Of first-order unknowns, only the velocities are known.
        """
        rows = []
        for k, name in enumerate(self.system.events):
            found = events[name]
            mine = np.full((len(found), 2 + 4 * self._n), np.nan)
            mine[:, 0], mine[:, 1] = k, found.t
            u_and_v: Any = (found.u, {}), (found.v, found.z), (found.u_after, {}), (found.v_after, found.z_after)
            for i, (state, z) in enumerate(u_and_v):
                begin, columns = 2 + i * self._n, np.column_stack([state, flat(z, len(found))])
                mine[:, begin : begin + columns.shape[1]] = columns
            rows.append(mine if counts is None else mine[: counts[name]])
        found_rows = np.concatenate([self.watch.log[:0], *rows])
        self._found, self.n_found = [found_rows[np.argsort(found_rows[:, 1], kind="stable")]], len(found_rows)

    def found(self) -> dict[str, Callable[[], Any]]:
        """Return functions that compute the fields of a solution from this observer, by the names of the fields."""
        return {"events": self.occurrences, "drift": self.drift, "extremes": self.extremes}

    def occurrences(self) -> dict[str, Occurrences]:
        """Return the occurrences of each event so far."""
        n = self._n
        rows = np.concatenate([self.watch.log[:0], *self._found])
        result = {}
        for k, name in enumerate(self.system.events):
            mine = rows[rows[:, 0] == k]
            states = [mine[:, 2 + i * n : 2 + (i + 1) * n] for i in range(4)]
            states = [np.ascontiguousarray(x[:, 0] if self._is_scalar else x) for x in states]
            result[name] = Occurrences(mine[:, 1].copy(), *states, labels=self.system.labels)
        return result

    def extremes(self) -> dict[str, Extremes]:
        """The extremes of each invariant and output so far."""
        result = {}
        for name, k in (*self.followed.invariants.items(), *self.followed.outputs.items()):
            rows = self._widest[:, self._columns(k)]
            has_shape = bool(self.followed.quantities[k].shape)
            result[name] = Extremes(*(row.copy() if has_shape else float(row[0]) for row in rows))
        return result

    def drift(self) -> dict[str, float]:
        """The maximum of |e_n - e_0| of each invariant over the ends of steps and the events; NaN if e became NaN."""
        return {name: self.drift_of(k) for name, k in self.followed.invariants.items()}

    def n_invariants(self, n_steps: int, counters: np.ndarray) -> int:
        """The number of steps of a run after which the invariants were evaluated; 0 if there are none."""
        return n_invariants(n_steps, float(counters[SPACING])) if self.followed.invariants else 0

    def drift_of(self, k: int) -> float:
        """The drift of one invariant."""
        (low, high), start = self.steps[:, self.column(k)], self.start_of(k)
        return float(np.maximum(start - low, high - start))

    def start_of(self, k: int) -> float:
        """The value of an invariant at the start."""
        return float(self._start[self.column(k)])

    def present_outputs(self) -> dict[str, Any]:
        """Return the values of each output in the latest state."""
        result = {}
        for name, k in self.followed.outputs.items():
            result[name] = self._values(k) if self.followed.quantities[k].shape else self._values(k)[0]
        return result

    def column(self, k: int) -> int:
        """The first column of a quantity in the arrays with a column for each value."""
        return int(self.followed.table[k, COLUMN])

    def _columns(self, k: int) -> slice:
        return slice(self.column(k), self.column(k) + self.followed.quantities[k].width)

    def _values(self, k: int) -> np.ndarray:
        """The values of a quantity in the latest state, shape (width,)."""
        begin = int(self.followed.table[k, OUT])
        return self._out[begin : begin + self.followed.quantities[k].width]


def _check_within(apply: Any, name: str, t0: float, start: tuple, params: np.ndarray) -> None:
    """Raise a ValueError if apply, called with copies of the state at the start, writes beyond the end of u or v."""
    u, v = (guarded(x) for x in start)
    with contextlib.suppress(Exception):  # apply may refuse a state in which the event does not occur
        apply.call(t0, u, v, params)
    if beyond(u) or beyond(v):
        raise ValueError(f"apply of events[{name!r}] writes beyond the end of u or v, which have {u.size} entries.")


def not_a_number(stepper: Any, t: float) -> ValueError:
    """Return the error for an event whose g is NaN, or whose apply gives a state that is not finite."""
    if stepper.ended == NOT_FINITE:
        return ValueError(
            f"apply of events[{stepper.ended_by!r}] gives infinity or NaN at t = {t:g}; it must give a finite state."
        )
    return ValueError(
        f"g of events[{stepper.ended_by!r}] is NaN in the step after t = {t:g}; it must be a number in every state."
    )
