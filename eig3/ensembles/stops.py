"""Events that end members which run in lanes with fixed steps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.lane_stops import STOP_COST, STOP_EVENT, STOP_ROWS, STOP_TIME, stops_kernel
from ..kernels.lanes import compile_caught
from ..kernels.loops.fixed import work_rows
from ..kernels.protocol import EVENT_VALUES, EVENTS, VECTOR
from ..methods import Method
from ..stepping.observer import Observer
from ..stepping.system import System
from .members import Members


class Found(NamedTuple):
    """The events that ended some members.

    Attributes
    ----------
    chosen : ndarray of bool
        Which of the members that were searched an event has ended.
    t, event, u, v : ndarray
        The times and the numbers of the events, and the states there, of shape (members, n).
    n_rhs : ndarray of int
        The number of evaluations of each of them.
    rows, row_of : ndarray
        All events at these times, as in the log of a run, and the place of each among these members.
    """

    chosen: np.ndarray
    t: np.ndarray
    event: np.ndarray
    u: np.ndarray
    v: np.ndarray
    n_rhs: np.ndarray
    rows: np.ndarray
    row_of: np.ndarray


class Stops:
    """The search for the events that end members.

    Parameters
    ----------
    system : System
        Of the single run of a member.
    members : Members
    method : Method
        The record that takes the steps.

    Attributes
    ----------
    system : System
    caught : Lanes
        What keeps the states of the steps, compiled for lanes.
    """

    def __init__(self, system: System, members: Members, method: Method) -> None:
        self.system, self._members, self._method = system, members, method
        self._kernel = stops_kernel(method.formulas, system.method.order, members.form)
        self.caught = compile_caught()

    def search(self, chosen: np.ndarray, index: np.ndarray, sides: np.ndarray, u: np.ndarray, v: np.ndarray) -> Found:
        """Search the step of some members that ends with step index `index`.

        `sides` has the shape (members, events): the side of the zero on which each g was before. u and v have the shape
        (2, n, members): they are those at the start and at the end of the step.
        """
        system, members, m, n = self.system, self._members, len(chosen), self._members.n
        t0, h, count = members.t_span[0], members.steps[chosen], len(system.event_table)
        look = Observer(system, None, n, work_rows(self._method.formulas, system.method.order)).arguments
        log = np.empty(((m + 1) * count, 2 + 4 * n))
        look = look._replace(watch=look.watch._replace(log=log))
        times = np.column_stack([t0 + (index - 1) * h, t0 + index * h])
        sides, states = np.ascontiguousarray(sides), np.array([u[0].T, v[0].T, u[1].T, v[1].T])
        params = (members.params[chosen] if members.has_own_params else members.params[None]).copy()
        found = np.empty((m, 4))
        tally = np.zeros(EVENTS + EVENT_VALUES * count)
        self._kernel(system.callback.address, look, tally, t0, times, sides, states, params, found)
        ended = ~np.isnan(found[:, STOP_TIME])
        t, event, cost, ends = found[ended].T[[STOP_TIME, STOP_EVENT, STOP_COST, STOP_ROWS]]
        row_of = np.repeat(np.arange(len(t)), np.diff(ends, prepend=0).astype(np.int64))
        n_rhs = 1 + self._evaluations(index[ended]) + cost.astype(np.int64)
        u_end, v_end = states[2:, ended]
        return Found(ended, t, event.astype(np.int64), u_end, v_end, n_rhs, log[: len(row_of)], row_of)

    def _evaluations(self, index: Any) -> Any:
        """Return the number of evaluations of the steps up to a step index."""
        names = self._method.formulas.names(VECTOR)
        started = np.minimum(index, names["START_STEPS"])
        return names["START_COST"] * started + names["COST"] * (index - started)
