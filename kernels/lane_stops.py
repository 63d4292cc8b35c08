# ruff: noqa: F821
"""Search steps of trajectories that ran in lanes with fixed steps for the events that end them, as single runs do."""

from __future__ import annotations

import functools
import math
from typing import Any

from numba.types import Array, float64, int64, none

from .compile.jit import compile_kernel
from .loops.formulas import Formulas
from .loops.pair import U_END, V_END, U, V
from .loops.search import search_names
from .loops.zeros import LAST, SIDE, G, event_of
from .protocol import (
    ENDED_BY,
    EVALUATIONS,
    EVENT_VALUES,
    EVENTS,
    LOGGED,
    LOOK,
    TERMINAL,
    TIME,
    Form,
    address_of,
    matrix_type,
    rows,
    vector_type,
)

#: The columns of what is found: the time of the event and its number, the evaluations of the search, and the number of
#: rows of the log up to there. The time is NaN if no event ended the trajectory.
STOP_TIME, STOP_EVENT, STOP_COST, STOP_ROWS = range(4)


def search_steps(address, look, counters, t0, times, sides, states, params, found):
    """Search a step of each of some trajectories; `times` has its two ends, shape (trajectories, 2).

    `sides` has the side of the zero on which each g was before, for a g that is zero at the start of the step. `states`
    has u and v at its start and at its end, shape (4, trajectories, n). Where an event ends a trajectory, the latter
    become those at the event.
    """
    watch, n = look.watch, states.shape[2]
    y, end = rows(watch.work[WORK:], PAIR_ROWS), 0
    for i in range(len(times)):
        own, t = params[i if len(params) > 1 else 0], times[i, 0]
        counters[:] = 0.0
        counters[LOGGED] = end
        for j in range(n):
            y[U][j], y[V][j] = states[0, i, j], states[1, i, j]
            y[U_END][j], y[V_END][j] = states[2, i, j], states[3, i, j]
        for k in range(len(watch.events)):
            mine = EVENTS + EVENT_VALUES * k
            g = EVENT(watch.events[k, G], t, states[0, i], states[1, i], own)
            counters[mine + SIDE] = g if g != 0 else sides[i, k]
            counters[mine + LAST] = -math.inf
        found[i, STOP_TIME] = math.nan
        if SEARCH(address, address_of(look), counters, t0, t, times[i, 1], n, own) == TERMINAL:
            found[i, STOP_TIME], found[i, STOP_EVENT] = counters[TIME], counters[ENDED_BY]
            found[i, STOP_COST], end = counters[EVALUATIONS] + 1, int(counters[LOGGED])
            for j in range(n):
                states[2, i, j], states[3, i, j] = y[U_END][j], y[V_END][j]
        found[i, STOP_ROWS] = end


@functools.cache
def stops_kernel(method: Formulas, order: int, form: Form) -> Any:
    """Compile `search_steps` for a fixed-step method of this order, or load it from the disk."""
    names = {**search_names(method, order, form), "EVENT": event_of(form)}
    matrix, cube = matrix_type, Array(float64, 3, "C")
    signature = none(int64, LOOK, vector_type, float64, matrix, matrix, cube, matrix, matrix)
    label = f"{method.label}_{order}_{form.name}" if method.is_own else ""
    return compile_kernel(search_steps, names, signature, label)
