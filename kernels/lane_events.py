# ruff: noqa: F821
"""What happens within a step of one lane: events, and times at which the state is wanted.

The lanes look only whether the function of an event has another sign at the end of a step, or whether a wanted time has
passed. Such a lane is examined alone: its rows are copied to the rows of a single run, and the functions of single
runs find the events, apply their resets, and evaluate the dense output.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba.types import Array, float64, int64
from numba.types import NamedTuple as Record

from .compile.jit import bound, element, outlined
from .loops.dense import evaluate
from .loops.follow import functions
from .loops.pair import A_END, U_END, V_END, A, U, V
from .loops.zeros import EPSILON, LAST, LATER, NEAR, SIDE, G, event_of, search_of_step
from .protocol import (
    ENDED_BY,
    EVENT_VALUES,
    EVENTS,
    GAP,
    LOGGED,
    NEXT,
    PASSED,
    RESET,
    TERMINAL,
    Form,
    address_of,
    matrix_type,
    rows,
    vector_type,
)

#: Why a lane is free before the end of its span, besides 0: a single run has to take the trajectory, or an event has
#: ended it.
BAD, STOPPED = 1.0, 2.0


class Sight(NamedTuple):
    """What the lanes see of events and of wanted times.

    Attributes
    ----------
    events : ndarray of int, shape (events,)
        The addresses of the functions of the events, compiled for lanes.
    sides, products : ndarray, shape (events, lanes)
        The side of its zero on which the function of each event is, and its value at the end of the step times this.
    due : ndarray, shape (lanes,)
        The next wanted time; infinity if there is none.
    counters : ndarray, shape (lanes, k)
        The counters of each lane, as in a single run.
    members : ndarray of int
        The trajectory of each row of the log of occurrences.
    logged : ndarray of int, shape (1,)
        Number of rows of the log that are written.
    steps, u, v : ndarray, shape (trajectories, times), (trajectories, times, n)
        Where the states at wanted times are written, and the steps that contain them.
    stops : ndarray, shape (trajectories, 2)
        The time of the event that ended a trajectory, and the number of this event.
    """

    events: Any
    sides: Any
    products: Any
    due: Any
    counters: Any
    members: Any
    logged: Any
    steps: Any
    u: Any
    v: Any
    stops: Any


_integers, _vector, _matrix, _cube = Array(int64, 1, "C"), vector_type, matrix_type, Array(float64, 3, "C")
SIGHT = Record(
    (_integers, _matrix, _matrix, _vector, _matrix, _integers, _integers, _matrix, _cube, _cube, _matrix), Sight
)


def see(p, of, y, sight):
    """Note what the lanes see at the end of a step, and return the number of lanes that see something.

    `of.sees` is 1 in lanes in which an event may have occurred, and 2 in those in which only a wanted time has passed.
    """
    time, ok, bad, due, sees = of.time, of.ok, of.bad, sight.due, of.sees
    for lane in range(LANES):
        sees[lane] = 2.0 if time[lane] >= due[lane] else 0.0
    for k in range(len(sight.events)):
        side, product = sight.sides[k], sight.products[k]
        EVENT_AT(sight.events[k])(time, y[U_END], y[V_END], p, side, product)
        for lane in range(LANES):
            sees[lane] = sees[lane] if product[lane] > 0 else 1.0
    count = 0
    for lane in range(LANES):
        sees[lane] = sees[lane] if (ok[lane] > 0) & (bad[lane] == 0) else 0.0
        count += sees[lane] > 0
    return count


def begin_sight(lane, m, t0, own, one, sight, look):
    """Look at the start of the trajectory m in a lane, as a single run does."""
    watch, counters = look.watch, sight.counters[lane]
    counters[:] = 0.0
    for k in range(len(watch.events)):
        mine = EVENTS + EVENT_VALUES * k
        counters[mine + SIDE] = EVENT(watch.events[k, G], t0, one[U], one[V], own)
        counters[mine + LAST] = -math.inf
        sight.sides[k, lane] = counters[mine + SIDE]
    if len(watch.times) > 0 and watch.times[0] == t0:
        sight.steps[m, 0] = 0.0
        for d in range(N):
            sight.u[m, 0, d], sight.v[m, 0, d] = one[U, d], one[V, d]
        counters[NEXT] = 1.0
    sight.due[lane] = due_after(counters, watch.times)


@element
def due_after(counters, times):
    """Return the next wanted time; infinity if there is none."""
    following = int(counters[NEXT])
    return times[following] if following < len(times) else math.inf


def look_alone(lane, alone, span, own, of, block, sight, look):
    """Look into the last step of a lane for its events and wanted times, and return the number of evaluations.

    After a reset, or a terminal event, the end of the step is the state there.
    """
    s, m, one, counters, watch = block.values, block.members[lane], block.one, sight.counters[lane], look.watch
    for k in range(ROWS):
        for d in range(N):
            one[k, d] = s[(k * N + d) * LANES + lane]
    y, f = ROWS_OF(one, ROWS), ALONE_AT(alone)
    t, step, t_end = of.there[lane], of.step[lane], of.time[lane]
    (u_there, v_there), coefficients = ROWS_OF(watch.work, 2), watch.work[2:]
    u_end, v_end = y[U_END], y[V_END]
    DENSE(f, t, step, own, N, y, coefficients)
    outcome, part, t_stop, first = PASSED, 1.0, t_end, sight.logged[0]
    if of.sees[lane] == 1:
        counters[LOGGED] = first
        outcome, part, t_stop = SEARCH(
            address_of(look), counters, span.t0, t, step, t_end, N, coefficients, u_end, v_end, u_there, v_there, own
        )
        sight.logged[0] = int(counters[LOGGED])
        for row in range(first, sight.logged[0]):
            sight.members[row] = m
        for k in range(len(watch.events)):
            sight.sides[k, lane] = counters[EVENTS + EVENT_VALUES * k + SIDE]
    if outcome != PASSED and outcome != RESET and outcome != TERMINAL:
        of.bad[lane] = BAD
        return DENSE_COST
    if outcome != TERMINAL:
        write_times(t, step, t_end, t_stop, coefficients, u_end, v_end, m, counters, sight, watch)
    else:  # times at the event, but for round-off, have the state before it
        near = NEAR * EPSILON * max(abs(span.t0), abs(t_stop))
        while watch.log[first, 1] < t_stop - near:  # an event without a reset, earlier in the step
            first += 1
        before, last = watch.log[first], t_stop - EPSILON * abs(t_stop)
        write_times(t, step, t_end, last, coefficients, u_end, v_end, m, counters, sight, watch)
        there = before[2:], before[2 + N :]
        write_times(t, part * step, last, t_stop + near, coefficients, *there, m, counters, sight, watch)
        sight.stops[m, 0], sight.stops[m, 1] = t_stop, counters[ENDED_BY]
        of.bad[lane] = STOPPED
    sight.due[lane] = due_after(counters, watch.times)
    if outcome == PASSED:
        return DENSE_COST
    PROJECT(look.follow, t_stop, u_there, v_there, own)
    f(t_stop, u_there, v_there, own, y[A])
    for d in range(N):
        s[(U_END * N + d) * LANES + lane], s[(V_END * N + d) * LANES + lane] = u_there[d], v_there[d]
        for row in (A, A_END):  # so that a multistep method has no acceleration before
            s[(row * N + d) * LANES + lane] = y[A][d]
    of.time[lane], of.before[lane], of.error[lane] = t_stop, part * step, 0.0
    if outcome == RESET:
        of.h[lane] = min(of.h[lane], LATER * counters[GAP])
    return DENSE_COST + 1


@outlined
def write_times(t, step, t_end, t_stop, coefficients, u_end, v_end, m, counters, sight, watch):
    """Write the states at the wanted times up to t_stop. Those at t_end and later are `u_end` and `v_end`."""
    while int(counters[NEXT]) < len(watch.times) and watch.times[int(counters[NEXT])] <= t_stop:
        row = int(counters[NEXT])
        if watch.times[row] >= t_end:
            for d in range(sight.u.shape[2]):
                sight.u[m, row, d], sight.v[m, row, d] = u_end[d], v_end[d]
        else:
            s = (watch.times[row] - t) / step
            evaluate(coefficients, s, sight.u.shape[2], sight.u[m, row], sight.v[m, row])
        sight.steps[m, row] = step
        counters[NEXT] += 1


def seeing(form: Form, names: dict[str, Any]) -> dict[str, Any]:
    """Return the elements ``SEE``, ``BEGIN_SIGHT`` and ``LOOK_ALONE`` for one form of right-hand side.

    `names` has the values of the names in capitals that depend on the method.
    """
    names = {
        **names,
        "EVENT": event_of(form),
        "SEARCH": search_of_step(form),
        "ROWS_OF": rows,
        "PROJECT": functions(form).project,
    }
    templates: dict[str, Any] = {"SEE": see, "BEGIN_SIGHT": begin_sight}
    return {
        **{name: element(bound(template, names)) for name, template in templates.items()},
        "LOOK_ALONE": outlined(bound(look_alone, names)),
    }
