"""What a run looks for within its steps: events, and times at which the state is wanted."""

from __future__ import annotations

import contextlib
import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals
from ..functions.events import Event, Occurrences
from ..functions.guard import beyond, guarded
from ..kernels.loops.zeros import NEAR
from ..kernels.protocol import EVENT_VALUES, EVENTS, LOGGED, NEXT, NOT_FINITE, SCALAR, Watch
from .system import System

_LOG_ROWS = 32  # occurrences of each event in the log, at least
_LOG_VALUES = 2**15  # values in the log of occurrences, after which the kernel returns
_NO_TIMES = np.empty(0)


def check_times(t_eval: ArrayLike | None, t0: float, t1: float) -> np.ndarray | None:
    """Return the times at which the state is wanted, or None."""
    if t_eval is None:
        return None
    times = reals(t_eval, "t_eval")
    if times.ndim != 1 or not times.size:
        raise ValueError(f"t_eval must be a 1-D array of at least one time, not of the shape {times.shape}.")
    if not (t0 <= times[0] and times[-1] <= t1 and (np.diff(times) > 0).all()):
        raise ValueError(f"t_eval must increase and lie within t_span, from {t0:g} to {t1:g}.")
    return times


def further_times(times: np.ndarray | None, t_eval: ArrayLike | None, end: float, t_end: float) -> np.ndarray | None:
    """Return the wanted times of a run that goes on from `end` to `t_end`: those up to now, and those of `t_eval`."""
    if t_eval is None:
        return times
    if times is None:
        raise ValueError("t_eval belongs to a run with t_eval: this one saves its states by save_every.")
    further: Any = check_times(t_eval, end, t_end)
    if further[0] <= max(end, times[-1]):
        raise ValueError(f"t_eval must begin after the end of the run at t = {end!r}, and after its own last time.")
    return np.concatenate([times, further])


class Watching:
    """The events of a run and the times at which its state is wanted, as the kernel needs them.

    Parameters
    ----------
    system : System
    times : ndarray or None
        The times at which the state is wanted.
    n : int
        The number of degrees of freedom.
    work_rows : int
        The number of rows of scratch that the kernel needs.

    Attributes
    ----------
    watch : Watch
    """

    def __init__(self, system: System, times: np.ndarray | None, n: int, work_rows: int) -> None:
        self._system, self.times, self._n = system, times, n
        self._is_scalar = system.form is SCALAR
        count = len(system.event_table)
        log = np.empty((count and max(_LOG_ROWS * count, _LOG_VALUES // (2 + 4 * n)), 2 + 4 * n))
        work, nothing = np.empty((work_rows, n)), np.empty((0, n))
        wanted = _NO_TIMES if times is None else times
        self.watch = Watch(system.event_table, log, wanted, _NO_TIMES, nothing, nothing, work, np.empty((4, count)))
        self._found: list[np.ndarray] = []

    @property
    def events(self) -> Mapping[str, Event]:
        return self._system.events

    def save_in(self, h_rows: np.ndarray, u_rows: np.ndarray, v_rows: np.ndarray) -> None:
        """Let the kernel write the steps and the states at the wanted times to these rows, of n values for u and v."""
        self.watch = self.watch._replace(h_rows=h_rows, u_rows=u_rows, v_rows=v_rows)

    def begin(self, tally: np.ndarray, t0: float, u: Any, v: Any, params: np.ndarray) -> None:
        """Write the signs of g at the start, and that there was no reset before.

        Raises
        ------
        ValueError
            If `apply` of an event writes beyond the end of u or v.
        """
        values = tally[EVENTS:].reshape(-1, EVENT_VALUES)
        values[:, 0], values[:, 1], values[:, 2:] = 0.0, -np.inf, 0.0
        for k, (name, (g, apply)) in enumerate(zip(self.events, self._system.event_callbacks, strict=True)):
            values[k, 0] = g.call(t0, u, v, params)
            if apply and not self._is_scalar:
                _check_within(apply, name, t0, (u, v), params)

    def fork(self) -> Watching:
        """Return an independent copy, which saves no states at wanted times."""
        other, watch = copy.copy(self), self.watch
        own = {name: getattr(watch, name).copy() for name in ("log", "work", "search")}
        none = {"times": _NO_TIMES, "h_rows": _NO_TIMES, "u_rows": watch.u_rows[:0], "v_rows": watch.v_rows[:0]}
        other.watch, other._found = watch._replace(**own, **none), list(self._found)
        other.times = None
        return other

    def want(self, times: np.ndarray | None) -> None:
        """Set the times at which the state is wanted, for a run that goes on."""
        self.times = times
        self.watch = self.watch._replace(times=_NO_TIMES if times is None else times)

    def collect(self, tally: np.ndarray) -> None:
        """Take the occurrences out of the log."""
        logged = int(tally[LOGGED])
        if logged:
            self._found.append(self.watch.log[:logged].copy())
            tally[LOGGED] = 0

    @property
    def n_found(self) -> int:
        """Number of blocks of occurrences so far, for `forget_from`."""
        return len(self._found)

    def forget_from(self, n_found: int) -> None:
        """Forget the occurrences since there were `n_found` blocks of them."""
        del self._found[n_found:]

    def finish(self, tally: np.ndarray, t0: float, t: float, h: float, u: Any, v: Any) -> None:
        """Write the state at t, the end of the run, at the wanted times that differ from t by round-off only.

        It is the state before the resets at t, if there are any.
        """
        if self.times is None:
            return
        near = NEAR * math.ulp(max(abs(t0), abs(t)))
        first, last = self.times.searchsorted([t, t + near])
        some = slice(min(first, int(tally[NEXT])), last)
        for block in (found for found in self._found[-1:] if len(found)):
            row = block[min(int(np.searchsorted(block[:, 1], t - near)), len(block) - 1)]  # they are in order of time
            if row[1] >= t - near:
                u, v = row[2 : 2 + self._n], row[2 + self._n : 2 + 2 * self._n]
        self.watch.u_rows[some], self.watch.v_rows[some], self.watch.h_rows[some] = u, v, h
        tally[NEXT] = max(last, int(tally[NEXT]))

    def recall(self, events: Mapping[str, Occurrences], counts: Mapping[str, int] | None = None) -> None:
        """Take the first occurrences of each event, or all, as those that were found so far.

        Their states may have fewer degrees of freedom, because integrals are not among them: those are NaN.
        """
        rows = []
        for k, name in enumerate(self.events):
            found = events[name]
            mine = np.full((len(found), 2 + 4 * self._n), np.nan)
            mine[:, 0], mine[:, 1] = k, found.t
            for i, state in enumerate((found.u, found.v, found.u_after, found.v_after)):
                begin, columns = 2 + i * self._n, state if state.ndim == 2 else state[:, None]
                mine[:, begin : begin + columns.shape[1]] = columns
            rows.append(mine if counts is None else mine[: counts[name]])
        found_rows = np.concatenate([self.watch.log[:0], *rows])
        self._found = [found_rows[np.argsort(found_rows[:, 1], kind="stable")]]

    def occurrences(self) -> dict[str, Occurrences]:
        """Return the occurrences of each event so far."""
        n = self._n
        rows = np.concatenate([self.watch.log[:0], *self._found])
        result = {}
        for k, name in enumerate(self.events):
            mine = rows[rows[:, 0] == k]
            states = [mine[:, 2 + i * n : 2 + (i + 1) * n] for i in range(4)]
            states = [np.ascontiguousarray(x[:, 0] if self._is_scalar else x) for x in states]
            result[name] = Occurrences(mine[:, 1].copy(), *states)
        return result

    def name(self, k: int) -> str:
        """Return the name of the event k."""
        return list(self.events)[k]


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
