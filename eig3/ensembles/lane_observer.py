"""The observer of each fixed step in the lanes of a block: invariants, outputs and events."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..functions.guard import are_untouched
from ..kernels.lane_stops import STOP_COST, STOP_EVENT, STOP_ROWS, STOP_TIME
from ..kernels.loops.fixed import work_rows
from ..kernels.protocol import (
    ADDRESS,
    COLUMN,
    EVENT_VALUES,
    EVENTS,
    HIGH,
    LOW,
    OUT,
    ROWS,
    T_HIGH,
    T_LOW,
    VECTOR,
    WIDTH,
    WORK,
    Follow,
)
from ..stepping.observer import Observer
from .lanewise import Setup

_GUARD_ROWS = 4  # of NaN on each side of the values of a quantity
_NONE = np.empty((2, 0))


class LaneObserver:
    """The quantities and the events of the members in the lanes of a block.

    Parameters
    ----------
    shared : Setup

    Attributes
    ----------
    numbers : ndarray
        All values that change during the run.
    record : Follow
        The argument of the kernel.
    start : dict of str to ndarray, shape (k, lanes)
        The values of the quantities at the start.
    """

    def __init__(self, shared: Setup) -> None:
        self._lanes, self._quantities = shared.layout.lanes, [q for q, _ in shared.quantities.values()]
        self._functions = [*(function for _, function in shared.quantities.values()), *shared.events]
        self._rows = {name: k for k, name in enumerate(shared.quantities)}
        self._table = np.zeros((len(self._functions), 6), dtype=np.int64)
        column, place = 0, _GUARD_ROWS * self._lanes
        for k, function in enumerate(self._functions):
            width = self._lanes * (self._quantities[k].width if k < len(self._quantities) else 1)
            self._table[k, [ADDRESS, WIDTH, COLUMN, OUT, WORK]] = function.address, width, column, place, -1
            column, place = column + width, place + width + _GUARD_ROWS * self._lanes
        self.numbers = np.full(place + 4 * column, np.nan)
        self._out, self._extremes = self.numbers[:place], self.numbers[place:].reshape(4, column)
        self._extremes[LOW], self._extremes[HIGH] = np.inf, -np.inf
        arrays = self._table, self._out, self._extremes, _NONE, _NONE.reshape(0, 2, 0), _NONE, np.empty(0)
        invariants, project = len(shared.histories.drift), shared.project.address if shared.project else 0
        self.record = Follow(*arrays, invariants, project=project)

    def begin(self, t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray) -> None:
        """Observe the start, with the values of the kernel."""
        for k, function in enumerate(self._functions):
            function.call(t, u, v, p, self._values(k), *self._extremes[:, self._columns(k)])
        self.check()
        self.start = {name: self.latest(name).copy() for name in self._rows}

    def save_in(self, rows: Mapping[str, np.ndarray]) -> None:
        """Make the kernel write the values in saved states to these arrays, of shape (states, k, lanes)."""
        for name, array in rows.items():
            self._table[self._rows[name], ROWS] = array.ctypes.data

    def check(self) -> None:
        """Raise a ValueError if a function has written beyond its values."""
        guards, end = _GUARD_ROWS * self._lanes, 0
        for k, quantity in enumerate(self._quantities):
            begin, end = end, int(self._table[k, OUT] + self._table[k, WIDTH])
            if not (are_untouched(self._out[begin : begin + guards]) and are_untouched(self._out[end : end + guards])):
                raise quantity.written_beyond()

    def latest(self, name: str) -> np.ndarray:
        """The values of a quantity in the latest state, shape (k, lanes)."""
        return self._values(self._rows[name]).reshape(-1, self._lanes)

    def extremes(self, name: str) -> np.ndarray:
        """The minimum and the maximum so far, and their times in the kernel, shape (4, k, lanes)."""
        return self._extremes[:, self._columns(self._rows[name])].reshape(4, -1, self._lanes)

    @property
    def crossings(self) -> tuple[np.ndarray, np.ndarray]:
        """Whether each g was zero or NaN, or has changed its sign, shape (events, lanes); and the times in the kernel.

        A time is NaN if g was zero or NaN at the start.
        """
        found = self._events
        return ~(found[LOW] > 0), found[T_LOW]

    def sides(self, lanes: np.ndarray) -> np.ndarray:
        """The sign of each g before it changed in some lanes, shape (lanes, events)."""
        latest = np.array([self._values(k) for k in range(len(self._quantities), len(self._functions))])
        return np.where(np.isnan(self._events[T_LOW]), latest, self._events[T_HIGH])[:, lanes].T

    @property
    def _events(self) -> np.ndarray:
        first = sum(quantity.width for quantity in self._quantities) * self._lanes
        return self._extremes[:, first:].reshape(4, -1, self._lanes)

    def _values(self, k: int) -> np.ndarray:
        begin = int(self._table[k, OUT])
        return self._out[begin : begin + int(self._table[k, WIDTH])]

    def _columns(self, k: int) -> slice:
        begin = int(self._table[k, COLUMN])
        return slice(begin, begin + int(self._table[k, WIDTH]))


def search_steps(
    shared: Setup, chosen: np.ndarray, index: np.ndarray, sides: np.ndarray, u: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """Search the last steps of some members for events, and store the events that end members there.

    Parameters
    ----------
    shared : Setup
    chosen, index : ndarray of int, shape (members,)
    sides : ndarray, shape (members, events)
        The sign of each g before the step.
    u, v : ndarray, shape (2, n, members)
        The states at the start and at the end of the step.

    Returns
    -------
    ndarray of bool, shape (members,)
        Whether an event has ended each member.
    """
    assert shared.stops
    histories, system, (kernel, _) = shared.histories, shared.prepared.system, shared.stops
    members, count = histories.members, len(shared.events)
    t0, h, names = members.t_span[0], members.steps[chosen], shared.method.formulas.names(VECTOR)
    look = Observer(system, None, members.n, work_rows(shared.method.formulas, system.method.order)).arguments
    log = np.empty(((len(chosen) + 1) * count, 2 + 4 * members.n))
    look = look._replace(watch=look.watch._replace(log=log))
    times = np.column_stack([t0 + (index - 1) * h, t0 + index * h])
    states = np.array([u[0].T, v[0].T, u[1].T, v[1].T])
    params = (members.params[chosen] if members.has_own_params else members.params[None]).copy()
    found, counters = np.empty((len(chosen), 4)), np.zeros(EVENTS + EVENT_VALUES * count)
    kernel(system.callback.address, look, counters, t0, times, np.ascontiguousarray(sides), states, params, found)
    ended = ~np.isnan(found[:, STOP_TIME])
    t, event, cost, ends = found[ended].T[[STOP_TIME, STOP_EVENT, STOP_COST, STOP_ROWS]]
    chosen, index = chosen[ended], index[ended]
    started = np.minimum(index, names["START_STEPS"])
    n_rhs = 1 + names["START_COST"] * started + names["COST"] * (index - started) + cost.astype(np.int64)
    row_of = np.repeat(np.arange(len(t)), np.diff(ends, prepend=0).astype(np.int64))
    u_end, v_end = states[2:, ended]
    histories.stop(chosen, index - 1, t, u_end, v_end, n_rhs)
    histories.note_events(chosen[row_of], log[: len(row_of)])
    histories.end_by_events(chosen, event, t)
    return ended
