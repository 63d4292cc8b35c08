"""What a run looks for within its steps: events, and times at which the state is wanted."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback
from ..functions.checks import check_names, reals
from ..functions.events import Event, Occurrences
from ..functions.guard import beyond, guarded
from ..kernels.loops.events import NOT_FINITE, RESTING, TERMINAL
from ..kernels.protocol import ENDED_BY, EVENT_VALUES, EVENTS, LOGGED, NEXT, SCALAR, WITHIN, Form, Watch
from ..result.growing import Rows
from ..result.solution import Status

_LOG_ROWS = 32  # occurrences of each event in the log, at least
_LOG_VALUES = 2**15  # values in the log of occurrences, after which the kernel returns
# Resets that follow each other within this part of the span, and so many spacings of t, do not end. The time of a reset
# has an error of a few spacings: with flights hardly longer, a body would pass through the floor.
_ZENO, _ZENO_SPACINGS = 1e-12, 1024
_ROUND_OFF = 16  # spacings of t by which the computed time of an event, or t0 + n h, may be wrong


def check_events(events: Any) -> Mapping[str, Event]:
    """Return the events by name."""
    if events is None:
        events = {}
    if not isinstance(events, Mapping) or not all(isinstance(event, Event) for event in events.values()):
        raise TypeError("events must be a dictionary of names and events, such as {'impact': eig3.Event(g)}.")
    check_names(events, "events")
    return events


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


class Watching:
    """The events of a run and the times at which its state is wanted, as the kernel needs them.

    Attributes
    ----------
    watch : Watch
    times : ndarray or None
        The times at which the state is wanted.
    """

    def __init__(
        self,
        events: Any,
        t_eval: ArrayLike | None,
        form: Form,
        start: tuple,
        t_span: tuple[float, float],
        params: np.ndarray,
        work_rows: int,
    ) -> None:
        t0, t1 = t_span
        self._t0 = t0
        self.events = check_events(events)
        self.times = check_times(t_eval, t0, t1)
        self._is_scalar = form is SCALAR
        self._n = n = 1 if self._is_scalar else len(start[0])
        self._callbacks = [_compiled(name, event, form) for name, event in self.events.items()]
        table = [
            (g.address, apply.address if apply else 0, event.direction, event.terminal)
            for (g, apply), event in zip(self._callbacks, self.events.values(), strict=True)
        ]
        count, rows = len(table), 0 if self.times is None else len(self.times)
        log = np.empty((count and max(_LOG_ROWS * count, _LOG_VALUES // (2 + 4 * n)), 2 + 4 * n))
        times = np.empty(0) if self.times is None else self.times
        self.watch = Watch(
            np.array(table, dtype=np.int64).reshape(count, 4),
            log,
            _least_gap(t0, t1),
            times,
            np.empty(rows),
            np.empty((rows, n)),
            np.empty((rows, n)),
            np.empty((work_rows, n)),
            np.empty((4, count)),
        )
        self._found: list[np.ndarray] = []
        for (_, apply), name in zip(self._callbacks, self.events, strict=True):
            if apply and not self._is_scalar:
                _check_within(apply, name, t0, start, params)
        self._signs = [self._callbacks[k][0].call(t0, *start, params) for k in range(count)]

    def begin(self, tally: np.ndarray, t0: float, u: Any, v: Any) -> None:
        """Write the signs of g at the start, and that there was no reset before; and the state, if it is wanted."""
        values = tally[EVENTS:].reshape(-1, EVENT_VALUES)
        values[:, 0], values[:, 1], values[:, 2:] = self._signs, -np.inf, 0.0
        if self.times is not None and self.times[0] == t0:
            self.watch.u_rows[0], self.watch.v_rows[0], self.watch.h_rows[0] = u, v, 0.0
            tally[NEXT] = 1

    def fork(self) -> Watching:
        """Return a copy whose occurrences and rows are independent."""
        other = copy.copy(self)
        watch = self.watch
        rows = {name: getattr(watch, name).copy() for name in ("log", "h_rows", "u_rows", "v_rows", "work", "search")}
        other.watch, other._found = watch._replace(**rows), list(self._found)
        return other

    def extended(self, t0: float, t1: float) -> Watching:
        """Return an independent copy for a run to a later end."""
        if self.times is not None:
            raise ValueError("a run with t_eval cannot be extended: integrate anew, with t_eval over the longer span.")
        other = self.fork()
        other.watch = other.watch._replace(zeno=_least_gap(t0, t1))
        return other

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

    def states_from(self, n_found: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return t, u and v before and after each occurrence since there were `n_found` blocks of them."""
        n = self._n
        rows = np.concatenate([self.watch.log[:0], *self._found[n_found:]])
        u, v = (np.concatenate([rows[:, i : i + n], rows[:, i + 2 * n : i + 3 * n]]) for i in (2, 2 + n))
        t = np.concatenate([rows[:, 1]] * 2)
        order = np.argsort(t, kind="stable")
        u, v = (np.ascontiguousarray(x[order, 0] if self._is_scalar else x[order]) for x in (u, v))
        return t[order], u, v

    def forget_from(self, n_found: int) -> None:
        """Forget the occurrences since there were `n_found` blocks of them."""
        del self._found[n_found:]

    def finish(self, tally: np.ndarray, t: float, h: float, u: Any, v: Any) -> None:
        """Write the state at t, the end of the run, at the wanted times that differ from t by round-off only.

        It is the state before the resets at t, if there are any.
        """
        if self.times is None:
            return
        near = _ROUND_OFF * float(np.spacing(max(abs(self._t0), abs(t))))
        first, last = np.searchsorted(self.times, [t, t + near], side="left")
        some = slice(min(first, int(tally[NEXT])), last)
        for row in (row for block in self._found[-1:] for row in block if row[1] >= t - near):
            u, v = row[2 : 2 + self._n], row[2 + self._n : 2 + 2 * self._n]
            break
        self.watch.u_rows[some], self.watch.v_rows[some], self.watch.h_rows[some] = u, v, h
        tally[NEXT] = max(last, int(tally[NEXT]))

    def restore(self, tally: np.ndarray) -> None:
        """Go on from a tally that a file has kept: between two steps, and with nothing in the log."""
        tally[LOGGED] = tally[NEXT] = tally[ENDED_BY] = tally[WITHIN] = 0  # places in arrays of this process

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

    def rows(self, tally: np.ndarray) -> Rows | None:
        """Return the states at the wanted times that the run has reached; None if no times were given."""
        if self.times is None:
            return None
        watch = self.watch
        return Rows(watch.times, watch.h_rows, watch.u_rows, watch.v_rows).at(slice(int(tally[NEXT])))

    def name(self, k: int) -> str:
        """Return the name of the event k."""
        return list(self.events)[k]


def _least_gap(t0: float, t1: float) -> float:
    """Return the time within which resets that follow each other do not end."""
    return _ZENO * (t1 - t0) + _ZENO_SPACINGS * float(np.spacing(max(abs(t0), abs(t1))))


def _check_within(apply: Any, name: str, t0: float, start: tuple, params: np.ndarray) -> None:
    """Raise a ValueError if apply, called with copies of the state at the start, writes beyond the end of u or v."""
    u, v = (guarded(x) for x in start)
    with contextlib.suppress(Exception):  # apply may refuse a state in which the event does not occur
        apply.call(t0, u, v, params)
    if beyond(u) or beyond(v):
        raise ValueError(f"apply of events[{name!r}] writes beyond the end of u or v, which have {u.size} entries.")


def _compiled(name: str, event: Event, form: Form) -> tuple[Any, Any]:
    g = check_callback(event.g, "event", form, f"g of events[{name!r}]")
    if event.apply is None:
        return g, None
    return g, check_callback(event.apply, "apply", form, f"apply of events[{name!r}]")


def ended_by_event(stepper: Any) -> tuple[Status, str]:
    """Return the status and the message of a run that an event ended."""
    name, t = stepper.ended_by, stepper.t
    if stepper.ended == TERMINAL:
        return Status.TERMINATED, f"The event {name!r} ended the run at t = {t:g}."
    if stepper.ended == RESTING:
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


def not_a_number(stepper: Any, t: float) -> ValueError:
    """Return the error for an event whose g is NaN, or whose apply gives a state that is not finite."""
    if stepper.ended == NOT_FINITE:
        return ValueError(
            f"apply of events[{stepper.ended_by!r}] gives infinity or NaN at t = {t:g}; it must give a finite state."
        )
    return ValueError(
        f"g of events[{stepper.ended_by!r}] is NaN in the step after t = {t:g}; it must be a number in every state."
    )
