# ruff: noqa: F821
"""What is observed in the steps of the lanes: events, wanted times, quantities, and the rows to write.

The lanes look only whether something is due at the end of a step: the function of an event has another sign, a wanted
time has passed, or a quantity or a row is due. Such a lane is examined alone: its rows are copied to the rows of a
single run, and the function that observes the steps of single runs observes this one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba.types import Array, float64, int64
from numba.types import NamedTuple as Record

from .compile.jit import bound, element, function_at, outlined
from .loops.extremes_within import follow_end
from .loops.follow import functions, save
from .loops.observe import OBSERVATION, OF_OBSERVING, Observation, Observed, next_due
from .loops.pair import A_END, U_END, V_END, A, U, V
from .loops.zeros import EPSILON, LAST, LATER, NEAR, SIDE, event_of
from .protocol import (
    COLUMN,
    DUE,
    ENDED_BY,
    EVALUATIONS,
    EVENT_VALUES,
    EVENTS,
    FIRST_ROW,
    GAP,
    HIGH,
    LOGGED,
    LOOK_WITHIN,
    LOW,
    NEXT,
    OUT,
    PART_END,
    PASSED,
    RESET,
    SPACING,
    T_HIGH,
    T_LOW,
    TERMINAL,
    WIDTH,
    Form,
    G,
    Span,
    matrix_type,
    pointer_to,
    record_at,
    vector_type,
)

#: Why a lane is free before the end of its span, besides 0: a single run has to take the trajectory, or an event has
#: ended it.
BAD, STOPPED = 1.0, 2.0

#: The entries of `LaneObservation.written`: the rows of occurrences, and of states.
OCCURRENCES, STATES = range(2)

#: The columns of `LaneObservation.ends`.
END_TIME, END_EVENT, END_STEP = range(3)

#: The largest number of states that are written for a step, besides those at wanted times.
MOST_ROWS = 2


class LaneObservation(NamedTuple):
    """What the lanes get to observe their steps.

    Attributes
    ----------
    observation : Observation
        As for a single run, but for the address of the look.
    looks : ndarray of int, shape (lanes,)
        The addresses of the looks of the lanes. All looks have the same log and the same rows.
    events : ndarray of int, shape (events,)
        The addresses of the functions of the events, compiled for lanes.
    sides, products : ndarray, shape (events, lanes)
        The side of its zero on which the function of each event is, and its value at the end of the step times this.
    due, due_steps : ndarray, shape (lanes,)
        The next wanted time, and the number of steps after which the lane is observed next; infinity if there is none.
    counters : ndarray, shape (lanes, k)
        The counters of each lane, as in a single run.
    spacing : float
        The entry `SPACING` of the counters.
    written : ndarray of int, shape (2,)
        See `OCCURRENCES`: how many rows are written.
    of_occurrences, of_states : ndarray of int
        The trajectory of each of these rows.
    numbers, last_numbers : ndarray, shape (lanes, k) and (trajectories, j)
        The numbers that change during a run with quantities, of each lane, and the first j of them of each trajectory
        that has ended.
    start : int
        The first of the numbers that are the values at the start.
    ends : ndarray, shape (trajectories, 3)
        The time of the end of a trajectory, the number of the event that ended it, and its last step.
    """

    observation: Any
    looks: Any
    events: Any
    sides: Any
    products: Any
    due: Any
    due_steps: Any
    counters: Any
    spacing: Any
    written: Any
    of_occurrences: Any
    of_states: Any
    numbers: Any
    last_numbers: Any
    start: Any
    ends: Any


_integers, _vector, _matrix = Array(int64, 1, "C"), vector_type, matrix_type
LANE_OBSERVATION = Record(
    (
        *(OBSERVATION, _integers, _integers, _matrix, _matrix, _vector, _vector, _matrix, float64),
        *(_integers, _integers, _integers, _matrix, _matrix, int64, _matrix),
    ),
    LaneObservation,
)


def see(p, of, y, seen):
    """Note in `of.sees` which lanes are to be observed at the end of a step, and return their number."""
    time, taken, ok, bad, sees = of.time, of.taken, of.ok, of.bad, of.sees
    for lane in range(LANES):
        sees[lane] = 1.0 if (time[lane] >= seen.due[lane]) | (taken[lane] >= seen.due_steps[lane]) else 0.0
    for k in range(len(seen.events)):
        side, product = seen.sides[k], seen.products[k]
        EVENT_AT(seen.events[k])(time, y[U_END], y[V_END], p, side, product)
        for lane in range(LANES):
            sees[lane] = sees[lane] if product[lane] > 0 else 1.0
    count = 0
    for lane in range(LANES):
        sees[lane] = sees[lane] if (ok[lane] > 0) & (bad[lane] == 0) else 0.0
        count += sees[lane] > 0
    return count


def begin_observing(lane, m, span, own, one, seen):
    """Observe the start of the trajectory m in a lane, as a single run does."""
    look, counters, t0 = LOOK_AT(seen.looks[lane]), seen.counters[lane], span.t0
    watch, follow = look.watch, look.follow
    counters[:] = 0.0
    counters[PART_END], counters[DUE], counters[SPACING] = 1.0, 1.0, seen.spacing
    for k in range(len(watch.events)):
        mine = EVENTS + EVENT_VALUES * k
        counters[mine + SIDE] = EVENT(watch.events[k, G], t0, one[U], one[V], own)
        counters[mine + LAST] = -math.inf
        seen.sides[k, lane] = counters[mine + SIDE]
    if len(follow.table) > 0:
        seen.numbers[lane, :] = 0.0
        follow.out[:] = math.nan  # a value that a function does not write stays NaN
        EVALUATE(follow, 0, t0, one[U], one[V], own)
        follow_end(follow, look.within)
        begin_extremes(follow, t0, seen.numbers[lane, seen.start :])
    if len(watch.times) > 0:
        row = m * len(watch.times)
        counters[FIRST_ROW] = row
        if watch.times[0] == t0:
            watch.h_rows[row] = 0.0
            for d in range(N):
                watch.u_rows[row, d], watch.v_rows[row, d] = one[U, d], one[V, d]
            save(follow, row)
            counters[NEXT] = 1.0
    plan_next(lane, 0, span.every, seen, watch.times)


@element
def begin_extremes(follow, t0, start):
    """Begin the extremes of all quantities with their values at the start."""
    for k in range(len(follow.table)):
        for j in range(max(follow.table[k, WIDTH], 1)):
            column, e = follow.table[k, COLUMN] + j, follow.out[follow.table[k, OUT] + j]
            start[column] = e
            follow.extremes[T_LOW, column] = follow.extremes[T_HIGH, column] = t0
            for ends in (follow.extremes, follow.steps, follow.parts[0]):
                ends[LOW, column], ends[HIGH, column] = e, e


@element
def plan_next(lane, taken, every, seen, times):
    """Note when a lane is observed next, after a number of steps."""
    counters, at_each = seen.counters[lane], seen.observation.at_each
    following = int64(counters[NEXT])
    seen.due[lane] = times[following] if following < len(times) else math.inf
    due = 0.0 if at_each == 1 else next_due(counters, at_each)
    seen.due_steps[lane] = min(due, float(taken - taken % every + every) if every > 0 else math.inf)


def observe_lane(lane, alone, span, own, of, block, seen):
    """Observe the last step of a lane, and return the number of evaluations.

    After a reset, or a terminal event, the end of the step is the state there.
    """
    s, m, one, counters = block.values, block.members[lane], block.one, seen.counters[lane]
    look = LOOK_AT(seen.looks[lane])
    watch = look.watch
    for k in range(ROWS):
        for d in range(N):
            one[k, d] = s[(k * N + d) * LANES + lane]
    t, step, t_end, taken = of.there[lane], of.step[lane], of.time[lane], int64(of.taken[lane])
    occurrence, row = seen.written[OCCURRENCES], seen.written[STATES]
    counters[LOGGED], counters[EVALUATIONS] = occurrence, 0.0
    limits = span.h_max, span.rtol, span.atol, span.is_relative, span.may_shorten, span.reads_time
    way = span.points, span.reach
    rows = span.t_rows, span.h_rows, span.u_rows, span.v_rows
    mine = Span(span.t0, span.t_end, own, 0, 0, max(span.every, 1), row, *limits, *way, *rows)
    parts = seen.observation
    within = parts.follow, parts.search, parts.write, parts.dense_evaluations
    parts = Observation(seen.looks[lane], parts.most_logged, parts.at_each, parts.observe, parts.dense, *within)
    observed = Observed(alone, pointer_to(mine), parts, counters, one)
    outcome, last_row, part, t_stop = OBSERVE_AT(parts.observe)(pointer_to(observed), taken, row, t, step, t_end)
    if outcome != PASSED and outcome != RESET and outcome != TERMINAL:
        of.bad[lane] = BAD
        return int64(counters[EVALUATIONS])
    for k in range(row, last_row):
        seen.of_states[k] = m
    for k in range(occurrence, int64(counters[LOGGED])):
        seen.of_occurrences[k] = m
    seen.written[OCCURRENCES], seen.written[STATES] = int64(counters[LOGGED]), last_row
    for k in range(len(watch.events)):
        seen.sides[k, lane] = counters[EVENTS + EVENT_VALUES * k + SIDE]
    if outcome == TERMINAL:
        FINISH_TIMES(m, span.t0, t_stop, part * step, occurrence, counters, look, own)
        seen.ends[m, END_EVENT] = counters[ENDED_BY]
        of.bad[lane] = STOPPED
    plan_next(lane, taken, span.every, seen, watch.times)
    if outcome == PASSED:
        return int64(counters[EVALUATIONS])
    for d in range(N):
        s[(U_END * N + d) * LANES + lane], s[(V_END * N + d) * LANES + lane] = one[U, d], one[V, d]
        for k in (A, A_END):  # so that a multistep method has no acceleration before
            s[(k * N + d) * LANES + lane] = one[A, d]
    of.time[lane], of.before[lane], of.error[lane] = t_stop, part * step, 0.0
    if outcome == RESET:
        of.h[lane] = min(of.h[lane], LATER * counters[GAP])
    return int64(counters[EVALUATIONS])


def finish_times(m, t0, t_stop, step, occurrence, counters, look, p):
    """Write the state before a terminal event at the wanted times that differ from its time only by round-off.

    `Observer.finish` does this for single runs.
    """
    watch, follow = look.watch, look.follow
    near = NEAR * EPSILON * max(abs(t0), abs(t_stop))
    while watch.log[occurrence, 1] < t_stop - near:  # an event without a reset, earlier in the step
        occurrence += 1
    n, k = watch.u_rows.shape[1], int64(counters[NEXT])
    u, v = watch.log[occurrence, 2 : 2 + n], watch.log[occurrence, 2 + n : 2 + 2 * n]
    EVALUATE(follow, follow.invariants, t_stop, u, v, p)
    while k > 0 and watch.times[k - 1] >= t_stop:
        k -= 1
    while k < len(watch.times) and watch.times[k] < t_stop + near:
        row = int64(counters[FIRST_ROW]) + k
        for d in range(n):
            watch.u_rows[row, d], watch.v_rows[row, d] = u[d], v[d]
        watch.h_rows[row] = step
        save(follow, row)
        k += 1
    counters[NEXT] = max(k, counters[NEXT])


def end_observing(lane, m, before, time, seen):
    """Keep what was observed in a trajectory that has ended."""
    seen.ends[m, END_TIME], seen.ends[m, END_STEP] = time, before
    for k in range(seen.last_numbers.shape[1]):
        seen.last_numbers[m, k] = seen.numbers[lane, k]


def observing(form: Form, names: dict[str, Any]) -> dict[str, Any]:
    """Return the elements ``SEE``, ``BEGIN_OBSERVING``, ``OBSERVE_LANE`` and ``END_OBSERVING`` for one form.

    `names` has the values of the names in capitals that depend on the method.
    """
    names = {
        **names,
        "EVENT": event_of(form),
        "EVALUATE": functions(form).evaluate,
        "LOOK_AT": record_at(LOOK_WITHIN),
        "OBSERVE_AT": function_at(OF_OBSERVING),
    }
    names["FINISH_TIMES"] = outlined(bound(finish_times, names))
    return {
        "SEE": element(bound(see, names)),
        "BEGIN_OBSERVING": outlined(bound(begin_observing, names)),
        "OBSERVE_LANE": outlined(bound(observe_lane, names)),
        "END_OBSERVING": element(end_observing),
    }
