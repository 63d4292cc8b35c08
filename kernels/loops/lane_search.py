# ruff: noqa: F821
"""Events of trajectories in lanes with fixed steps.

After each step, the lanes evaluate the functions of the events. Where one has changed its sign, the lane is searched
alone: its step is copied to the rows of a single run, and the search of single runs looks at it. After a reset, the
lane continues from the state that the search has reached at the end of the step. A terminal event ends it.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

from numba.types import Array, float64, int64, none
from numba.types import NamedTuple as Record

from ..compile.jit import bound, called_by_symbol, element
from ..protocol import (
    COLUMN,
    ENDED_BY,
    EVALUATIONS,
    EVENT_VALUES,
    EVENTS,
    FOLLOW,
    HIGH,
    LOGGED,
    LOOK,
    LOW,
    OUT,
    PASSED,
    RESET,
    T_HIGH,
    T_LOW,
    TERMINAL,
    TIME,
    WIDTH,
    Form,
    Look,
    matrix_type,
    pointer_to,
    record_at,
    row_type,
    rows,
    steps_at,
    vector_type,
)
from .follow import functions, widen
from .formulas import Formulas
from .pair import U_END, V_END, A, U, V
from .search import search_names
from .zeros import SIDE

#: What a lane does: its events are searched; it has no trajectory; a terminal event has ended its trajectory; or a
#: single run has to take it.
SEARCHED, IDLE, STOPPED, LOST = 0.0, 1.0, 2.0, 3.0

#: The rows of `LaneWatch.ends` before u and v: the time, the event and the step index.
END_TIME, END_EVENT, END_STEP, END_STATE = range(4)


class LaneWatch(NamedTuple):
    """What the lanes of a block with fixed steps get to look for events.

    Attributes
    ----------
    look : Look
        The look of a single run, which one lane after another uses.
    rhs : int
        The address of the right-hand side of a single run.
    may_search : int
        0 if single runs have to take the trajectories with events.
    t0 : float
        The time at the start.
    p, own, first_own : ndarray, ndarray of int, int
        The parameters of a single run; the places there of the values that each trajectory has for itself; and where
        the rows of these begin in the parameters of the block.
    values : Follow
        The functions of the events, compiled for lanes. The row `LOW` of the extremes has the side of its zero on which
        each function was, or NaN if it was at its zero. It is 0 in lanes that are not searched. The first value of each
        function in the row `HIGH` is the number of changes.
    places, columns : ndarray of int, shape (events,)
        Where the values of each event begin in `values.out`, and its sides in the extremes.
    has_crossed, doing : ndarray, shape (lanes,)
        Whether a function has changed its sign, and what the lane does: see `SEARCHED`.
    h, unit : ndarray, shape (lanes,)
        The steps, and the factor of v in the block.
    before : ndarray, shape (2, n lanes)
        u and v before the step.
    counters : ndarray, shape (lanes, k)
        The counters of a single run.
    evaluations : ndarray, shape (lanes,)
        The evaluations of the right-hand side in searches.
    n_logged, lane_of_row : ndarray of int, shape (1,) and (rows,)
        The number of rows in the log, and the lane of each.
    ends : ndarray, shape (3 + 2 n, lanes)
        The end of each trajectory that an event has ended: see `END_TIME`.
    last, extremes : ndarray, shape (values lanes,) and (4, values lanes)
        The quantities and their extremes at this end.
    """

    look: Any
    rhs: Any
    may_search: Any
    t0: Any
    p: Any
    own: Any
    first_own: Any
    values: Any
    places: Any
    columns: Any
    has_crossed: Any
    doing: Any
    h: Any
    unit: Any
    before: Any
    counters: Any
    evaluations: Any
    n_logged: Any
    lane_of_row: Any
    ends: Any
    last: Any
    extremes: Any


_integers, _vector, _matrix = Array(int64, 1, "C"), vector_type, matrix_type
LANE_WATCH = Record(
    (
        *(LOOK, int64, int64, float64, _vector, _integers, int64, FOLLOW, _integers, _integers, _vector, _vector),
        *(_vector, _vector, _matrix, _matrix, _vector, _integers, _integers, _matrix, _vector, _matrix),
    ),
    LaneWatch,
)

#: The type of the look of a block that searches its steps.
LOOK_IN_LANES = Record((LANE_WATCH, FOLLOW, none), Look)
_look_at = record_at(LOOK_IN_LANES)


def search_lanes(look, i, t, y, steps):
    """Search the step to step index i in the lanes in which the function of an event has changed its sign."""
    watch, lanes = look.watch, look.watch.has_crossed.size
    values, count = watch.values, 0.0
    EVALUATE_LANES(values, 0, t, y[0], y[1], steps.p)
    for k in range(len(values.table)):
        count += values.extremes[HIGH, values.table[k, COLUMN]]
    if count == 0:  # as in most steps
        return
    has_crossed = watch.has_crossed
    has_crossed[:] = 0.0
    for k in range(len(watch.places)):
        place, column = watch.places[k], watch.columns[k]
        for lane in range(lanes):
            if not values.out[place + lane] * values.extremes[LOW, column + lane] >= 0:
                has_crossed[lane] = 1.0
    for lane in range(lanes):
        if has_crossed[lane] > 0 and watch.doing[lane] == SEARCHED:  # g may be NaN in the other lanes
            outcome = SEARCH_LANE(pointer_to(look), pointer_to(watch.look), pointer_to(steps), lane, i, y[0], y[1])
            if outcome == RESET:
                if RESTARTS > 0:
                    START_LANE(watch, lane, y, steps.h)
                else:  # a starter would have to take its first steps
                    leave_lane(watch, lane, LOST)


def start_lane(watch, lane, y, h):
    """Write the state of a lane after a reset, and the past values of the method, which starts anew."""
    work, lanes, unit = watch.look.watch.work, watch.doing.size, watch.unit[lane]
    pair = rows(work[WORK:], PAIR_ROWS)
    for j in range(work.shape[1]):
        place, u, v = j * lanes + lane, pair[U_END][j], unit * pair[V_END][j]
        y[0][place], y[1][place] = u, v
        if PAST > 0:
            past = START(u, v, unit * unit * pair[A][j], h)
            for k in range(PAST):
                y[2 + k][place] = past[k]


def search_lane(of_look, of_alone, of_steps, lane, i, u, v):
    """Search the step of a lane to step index i, and return the outcome, which is PASSED if the lane is lost.

    The look, the look of a single run and the steps are at the addresses. u and v are the rows of the block at the end
    of the step. The state after a reset, and its acceleration, are in the rows of the single run.
    """
    look, steps = _look_at(of_look), steps_at(of_steps)
    watch, follow = look.watch, look.follow
    if watch.may_search == 0:
        leave_lane(watch, lane, LOST)
        return PASSED
    alone, mine = watch.look, watch.counters[lane]
    work, first, unit, h = alone.watch.work, watch.n_logged[0], watch.unit[lane], watch.h[lane]
    lanes, n, pair = watch.doing.size, work.shape[1], rows(work[WORK:], PAIR_ROWS)
    for j in range(n):
        place = j * lanes + lane
        pair[U][j], pair[V][j] = watch.before[0, place], watch.before[1, place] / unit
        pair[U_END][j], pair[V_END][j] = u[place], v[place] / unit
    for k in range(len(watch.own)):
        watch.p[watch.own[k]] = steps.p[watch.first_own + k * lanes + lane]
    for j in range(alone.follow.extremes.shape[1]):
        for ends in (alone.follow.extremes, alone.follow.steps, alone.follow.parts[0]):
            ends[LOW, j], ends[HIGH, j] = math.inf, -math.inf
    mine[LOGGED], mine[EVALUATIONS] = first, 0.0
    t = watch.t0 + i * h
    outcome = SEARCH(watch.rhs, of_alone, mine, watch.t0, watch.t0 + (i - 1) * h, t, n, watch.p)
    if outcome != PASSED and outcome != RESET and outcome != TERMINAL:
        leave_lane(watch, lane, LOST)
        return PASSED
    for row in range(first, int64(mine[LOGGED])):
        watch.lane_of_row[row] = lane
    watch.n_logged[0] = int64(mine[LOGGED])
    for k in range(len(alone.watch.events)):
        side = mine[EVENTS + EVENT_VALUES * k + SIDE]
        watch.values.extremes[LOW, watch.columns[k] + lane] = side if side != 0 else math.nan
    if outcome != PASSED:
        t = mine[TIME] if outcome == TERMINAL else t
        RHS(watch.rhs)(t, pair[U_END], pair[V_END], watch.p, pair[A])
        mine[EVALUATIONS] += 1
    watch.evaluations[lane] += mine[EVALUATIONS]
    widen_lane(lane, lanes, alone.follow, follow, watch.t0, steps.t0, steps.h / h)
    if outcome == TERMINAL:
        EVALUATE(alone.follow, 0, t, pair[U_END], pair[V_END], watch.p)
        end_lane(lane, watch, follow, t, i, pair)
    return outcome


@element
def widen_lane(lane, lanes, alone, follow, t0, t0_of_block, ratio):
    """Widen the extremes of a lane by those at the events in its step."""
    for k in range(len(follow.table)):
        for j in range(max(alone.table[k, WIDTH], 1)):
            column, place = alone.table[k, COLUMN] + j, follow.table[k, COLUMN] + j * lanes + lane
            low, high, extremes = alone.extremes[LOW, column], alone.extremes[HIGH, column], alone.extremes
            if low <= high or low != low:
                widen(follow.extremes, place, low, t0_of_block + ratio * (extremes[T_LOW, column] - t0))
                widen(follow.extremes, place, high, t0_of_block + ratio * (extremes[T_HIGH, column] - t0))


@element
def end_lane(lane, watch, follow, t, i, pair):
    """Keep the end of a trajectory that an event has ended. Later steps of the lane mean nothing."""
    ends, lanes, alone, counters = watch.ends, watch.doing.size, watch.look.follow, watch.counters[lane]
    leave_lane(watch, lane, STOPPED)
    ends[END_TIME, lane], ends[END_EVENT, lane], ends[END_STEP, lane] = t, counters[ENDED_BY], i
    n = (len(ends) - END_STATE) // 2
    for j in range(n):
        ends[END_STATE + j, lane], ends[END_STATE + n + j, lane] = pair[U_END][j], pair[V_END][j]
    for k in range(len(follow.table)):
        for j in range(max(alone.table[k, WIDTH], 1)):
            place = follow.table[k, COLUMN] + j * lanes + lane
            watch.last[place] = alone.out[alone.table[k, OUT] + j]
            for row in range(len(watch.extremes)):
                watch.extremes[row, place] = follow.extremes[row, place]


@element
def leave_lane(watch, lane, doing):
    """Search the lane no more."""
    watch.doing[lane] = doing
    for k in range(len(watch.columns)):
        watch.values.extremes[LOW, watch.columns[k] + lane] = 0.0


@element
def is_full(look):
    """Return whether the log has little room left."""
    return 2 * look.watch.n_logged[0] > len(look.watch.look.watch.log)


@functools.cache
def searching_in_lanes(method: Formulas, order: int, form: Form) -> dict[str, Any]:
    """Return the values of the names in capitals of a kernel that searches its steps in lanes."""
    names = search_names(method, order, form)
    names |= {"PAST": method.past, "START": element(method.start), "RESTARTS": int(method.start_steps == 0)}
    names |= {"RHS": form.at("rhs"), "EVALUATE": functions(form).evaluate}
    label = f"{names['PAIR_ROWS']}_{names['WORK']}_{form.name}"
    of_lane = int64(int64, int64, int64, int64, int64, row_type, row_type)
    names["SEARCH_LANE"] = called_by_symbol(search_lane, names, of_lane, label)
    names["START_LANE"] = element(bound(start_lane, names))
    return names
