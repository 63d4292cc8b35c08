# ruff: noqa: F821
"""Runs with tolerances of many trajectories at once, in the lanes of SIMD registers.

Each lane has its own time, step, error and acceptance, which are selected without branches. A trajectory that has ended
hands its lane to the next one at once: no lane waits. The formulas of the steps, the error and the step control are
shared with single runs, see `eig3.kernels.loops.variable`. What happens rarely is left to a single run: a step below
the resolution of the time, too many steps, a force that does not act yet. OBSERVES says whether the steps are observed,
see `eig3.kernels.lane_observation`.

All values of a block are in one array, in rows at constant places: LLVM then knows without checks that the rows do not
overlap. Value j of the trajectory in a lane is at index j * lanes + lane of a row.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from numba.extending import intrinsic
from numba.types import Array, NamedUniTuple, UniTuple, float64, int64, intp, none
from numba.types import NamedTuple as Record

from .compile.jit import bound, compile_kernel, element, function_at
from .compile.numba_internals import Strip, parts_of, wide_vectors
from .lane_observation import BAD, LANE_OBSERVATION, MOST_ROWS, OCCURRENCES, STATES, STOPPED, observing
from .lanes import BlockLayout, Lanes, compile_template
from .loops.beginning import RESOLUTION, beginning, least_size, least_sizes
from .loops.controller import LEAST_ERROR, exponent, next_step, shrinkage
from .loops.formulas import variable_formulas
from .loops.pair import A_END, U_END, U_MOST, V_END, V_MOST, A, U, V
from .protocol import (
    EVALUATIONS,
    SPAN,
    STEP,
    STEP_BEFORE,
    TIME,
    U_SIZE,
    V_SIZE,
    Form,
    Span,
    matrix_type,
    pointer_to,
    vector_type,
)

#: How a trajectory ended: it has not yet, it reached the end of its span, an event ended it, or it is left to a single
#: run.
RUNNING, REACHED, TERMINATED, LEFT = range(4)

#: The columns of the results: the number of steps, of rejected steps and of evaluations, and how it ended.
TAKEN, REJECTED, EVALUATED, ENDED = range(4)

#: The entries of `Block.place`: the next trajectory, and the number of those that have not ended.
NEXT, OPEN = range(2)

_FAR = 0.25  # of the longest way of a point in a step: a longer one may count more than the errors
_OVERFLOWING = 1e150  # a single run says what is wrong with a larger motion

_EVENT = none(*[vector_type] * 6)
_event_at, _rhs_at = function_at(_EVENT), function_at(none(*[vector_type] * 5))
_project_at = function_at(float64(float64, *[vector_type] * 3))


class LaneRows(NamedTuple):
    """The rows with one value for each lane.

    `there` is the time of a stage, `step` the step of the trial, `h` the next step and `longest` the longest. `before`
    is the step before, and `error` the logarithm of its error. The error of a trial is relative to at least `u_least`
    and `v_least`, and v has no separate size up to `v_blur`. `bad` is `BAD` if a single run has to take the trajectory,
    and `STOPPED` if an event has ended it. `ok` is 1 if the trial was accepted, and `sees` is 1 if the lane is to be
    observed. The last rows are for sums and maxima.
    """

    time: Any
    there: Any
    h: Any
    step: Any
    longest: Any
    before: Any
    error: Any
    u_size: Any
    v_size: Any
    u_least: Any
    v_least: Any
    v_blur: Any
    rejected: Any
    taken: Any
    trials: Any
    bad: Any
    ok: Any
    sees: Any
    square: Any
    total: Any
    most: Any
    more: Any


class Block(NamedTuple):
    """What the lanes keep from one call of the kernel to the next.

    Attributes
    ----------
    values, p : ndarray
        The values of the lanes, and their parameters.
    members : ndarray of int, shape (lanes,)
        The trajectory in each lane, or -1.
    place : ndarray of int
        See `NEXT`.
    one, counters : ndarray
        Room for the rows of one trajectory, and for its start.
    h_first : float
        The first step, or 0 if it is not given.
    """

    values: Any
    p: Any
    members: Any
    place: Any
    one: Any
    counters: Any
    h_first: Any


class Trajectories(NamedTuple):
    """The trajectories: their starts, which become their ends, their longest steps, and their results.

    `params` has one row for each of them, or one for all.
    """

    u: Any
    v: Any
    params: Any
    longest: Any
    counts: Any


def adaptive(rhs, alone, project, count, span, block, trajectories, seen):
    """Take `count` steps in each lane, or fewer if all trajectories end, or if rows are full. Return their number.

    `rhs`, `alone` and `project` are addresses: the right-hand side for lanes and for one trajectory, and the projection
    for lanes, or 0 without constraints. The parameters of `span` are not used, and all trajectories write to its rows.
    """
    s, members, place, atol, t_end = block.values, block.members, block.place, span.atol, span.t_end
    y = ROWS(s)
    of = LANE_ROWS(s)
    time, h, step, before, error, rejected = of.time, of.h, of.step, of.before, of.error, of.rejected
    taken, trials, bad, ok, square = of.taken, of.trials, of.bad, of.ok, of.square
    there, f, share = of.there, RHS_AT(rhs), least_size(span.rtol)
    steps = 0
    while steps < count:
        if OBSERVES and is_full(span, seen):
            break
        ended = 0
        for lane in range(LANES):
            ended += (bad[lane] > 0) | (time[lane] >= t_end) | (taken[lane] >= span.count)
        if ended > 0:
            for lane in range(LANES):
                if bad[lane] > 0 or time[lane] >= t_end or taken[lane] >= span.count:
                    if members[lane] >= 0:
                        END(lane, span, of, y, block, trajectories, seen)
                    while place[NEXT] < len(trajectories.u) and members[lane] < 0:
                        BEGIN_LANE(lane, alone, span, of, y, block, trajectories, seen)
            if place[OPEN] == 0:
                break
        for lane in range(LANES):
            remaining = t_end - time[lane]
            x = remaining if h[lane] >= remaining else h[lane]
            is_long = (x > 0) & (x >= RESOLUTION * abs(time[lane] + x))
            bad[lane] = bad[lane] if is_long | (h[lane] >= remaining) else BAD
            step[lane] = x
            of.u_least[lane], of.v_least[lane] = share * of.u_size[lane], share * of.v_size[lane]
            of.v_blur[lane] = 0.0
        TRIAL(f, time, of.there, step, before, block.p, y)
        if span.is_relative == 1:
            rest(span, of, y[A], y[A_END])
        SQUARE(step, span.rtol, atol, of.u_least, of.v_least, of.total, of.most, of.more, square, y)
        for lane in range(LANES):
            x, e = step[lane], exponent(square[lane])
            is_ok = (square[lane] <= 1.0) & (x > 0)
            longer = next_step(x, before[lane], e, error[lane], rejected[lane] > 0, of.longest[lane], ORDER)
            shorter = x * shrinkage(square[lane], ORDER)
            reached = t_end if h[lane] >= t_end - time[lane] else time[lane] + x
            h[lane] = longer if is_ok else (shorter if x > 0 else h[lane])
            there[lane] = time[lane]
            time[lane] = reached if is_ok else time[lane]
            error[lane] = max(e, LEAST_ERROR) if is_ok else error[lane]
            before[lane] = x if is_ok else before[lane]
            rejected[lane] = 0.0 if is_ok else 1.0
            ok[lane] = 1.0 if is_ok else 0.0
            taken[lane] += 1.0 if is_ok else 0.0
            trials[lane] += 1.0 if x > 0 else 0.0
        if span.reads_time == 1:
            for lane in range(LANES):  # the force may not act yet
                bad[lane] = BAD if (ok[lane] > 0) & (square[lane] == 0) else bad[lane]
        for d in range(span.points):
            for lane in range(LANES):  # a single run shortens such steps
                is_far = abs(y[U_END][d * LANES + lane] - y[U][d * LANES + lane]) > FAR * span.reach
                bad[lane] = BAD if (ok[lane] > 0) & is_far else bad[lane]
        if project != 0:
            PROJECT_AT(project)(span.t0, y[U_END], y[V_END], block.p)
        if OBSERVES and SEE(block.p, of, y, seen) > 0:
            for lane in range(LANES):
                if of.sees[lane] > 0:
                    m = members[lane]
                    own = trajectories.params[m if len(trajectories.params) > 1 else 0]
                    evaluations = OBSERVE_LANE(lane, alone, span, own, of, block, seen)
                    trajectories.counts[m, EVALUATED] += evaluations
        ADVANCE(ok, y)
        if span.is_relative == 1:
            widen_sizes(atol, of, y)
        steps += 1
    return steps


def is_full(span, seen):
    """Return whether there is no room for what all lanes may write in a step."""
    has_events, has_rows = len(seen.events) > 0, len(span.t_rows) > 0
    occurrences = seen.written[OCCURRENCES] + LANES * len(seen.events)
    states = seen.written[STATES] + LANES * MOST_ROWS
    return (has_events and occurrences > len(seen.of_occurrences)) or (has_rows and states > len(span.t_rows))


def end(lane, span, of, y, block, trajectories, seen):
    """Write the end of the trajectory in a lane."""
    time, taken, trials, bad = of.time, of.taken, of.trials, of.bad
    m, is_stopped = block.members[lane], bad[lane] == STOPPED
    is_left = not is_stopped and (bad[lane] > 0 or time[lane] < span.t_end)
    for d in range(N):
        trajectories.u[m, d], trajectories.v[m, d] = y[U][d * LANES + lane], y[V][d * LANES + lane]
        is_left = is_left or not (abs(trajectories.u[m, d]) < OVERFLOWING and abs(trajectories.v[m, d]) < OVERFLOWING)
    steps, tried = int64(taken[lane]), int64(trials[lane])
    trajectories.counts[m, TAKEN], trajectories.counts[m, REJECTED] = steps, tried - steps
    trajectories.counts[m, EVALUATED] += COST * tried
    trajectories.counts[m, ENDED] = LEFT if is_left else (TERMINATED if is_stopped else REACHED)
    if OBSERVES:
        END_OBSERVING(lane, m, of.before[lane], time[lane], seen)
    block.members[lane] = -1
    block.place[OPEN] -= 1
    bad[lane], taken[lane], trials[lane], time[lane] = 0.0, 0.0, 0.0, span.t_end


def begin_lane(lane, alone, span, of, y, block, trajectories, seen):
    """Begin the next trajectory in a lane, as a single run begins."""
    one, counters, m = block.one, block.counters, block.place[NEXT]
    block.place[NEXT] += 1
    own = trajectories.params[m if len(trajectories.params) > 1 else 0]
    for d in range(N):
        one[U, d], one[V, d], one[A, d] = trajectories.u[m, d], trajectories.v[m, d], math.nan
        one[U_MOST, d], one[V_MOST, d] = 0.0, 0.0
        one[A_END, d] = 0.0  # of the trajectory before, which must not act on the first step of this one
    ALONE_AT(alone)(span.t0, one[U], one[V], own, one[A])
    for d in range(N):
        if not math.isfinite(one[A, d]):
            trajectories.counts[m, ENDED] = LEFT
            block.place[OPEN] -= 1
            return
    counters[:] = 0.0
    longest = trajectories.longest[m]
    counters[TIME], counters[STEP] = span.t0, min(block.h_first, longest)
    limits = longest, span.rtol, span.atol, span.is_relative, 0, 0, span.points, span.reach
    mine = Span(span.t0, span.t_end, own, 0, 0, 0, 0, *limits, counters, counters, one, one)
    BEGIN(alone, pointer_to(mine), counters, ORDER, one)
    of.time[lane], of.h[lane], of.before[lane], of.error[lane] = span.t0, counters[STEP], counters[STEP_BEFORE], 1.0
    of.u_size[lane], of.v_size[lane], of.rejected[lane] = counters[U_SIZE], counters[V_SIZE], 0.0
    of.longest[lane] = longest
    trajectories.counts[m, EVALUATED] = 1 + int64(counters[EVALUATIONS])
    if len(block.p) > len(own):  # each lane has its own parameters
        for k in range(len(own)):
            block.p[k * LANES + lane] = own[k]
    for d in range(N):
        j = d * LANES + lane
        y[U][j], y[V][j], y[A][j] = one[U, d], one[V, d], one[A, d]
        y[U_MOST][j], y[V_MOST][j] = one[U_MOST, d], one[V_MOST, d]
        y[V_MOST + 1][j] = one[A, d]  # the acceleration before the first step, for a multistep method
    if OBSERVES:
        BEGIN_OBSERVING(lane, m, span, own, one, seen)
    block.members[lane] = m


def rest(span, of, a, a_end):
    """Set the least sizes in lanes in which nothing has moved, as `beginning.at_rest` does."""
    u_size, v_size = of.u_size, of.v_size
    resting = 0
    for lane in range(LANES):
        resting += (u_size[lane] == 0) | (v_size[lane] == 0)
    if resting > 0:
        for lane in range(LANES):
            if u_size[lane] == 0 or v_size[lane] == 0:
                a_size = 0.0
                for d in range(N):
                    if span.atol[0, d] < math.inf:
                        a_size = max(a_size, abs(a[d * LANES + lane]), abs(a_end[d * LANES + lane]))
                length = span.t_end - span.t0
                of.u_least[lane], of.v_least[lane], of.v_blur[lane] = least_sizes(
                    u_size[lane], v_size[lane], a_size, of.time[lane] + of.step[lane], length, span.rtol
                )


def widen_sizes(atol, of, y):
    """Widen the sizes of u and v, of each degree of freedom and of all."""
    u, v, u_most, v_most = y[U], y[V], y[U_MOST], y[V_MOST]
    u_size, v_size, v_blur, ok, most, more = of.u_size, of.v_size, of.v_blur, of.ok, of.most, of.more
    for lane in range(LANES):
        most[lane], more[lane] = u_size[lane], v_size[lane]
    for d in range(N):
        counts = atol[0, d] < math.inf
        for lane in range(LANES):
            j = d * LANES + lane
            u_now, v_now = max(u_most[j], abs(u[j])), max(v_most[j], abs(v[j]))
            u_most[j], v_most[j] = u_now, v_now
            most[lane] = max(most[lane], u_now if counts and v_now > 0 else 0.0)
            more[lane] = max(more[lane], v_now if counts else 0.0)
    for lane in range(LANES):
        is_new = (more[lane] > v_blur[lane]) & (ok[lane] > 0)
        u_size[lane], v_size[lane] = (most[lane] if is_new else u_size[lane]), (more[lane] if is_new else v_size[lane])


def watched(t, u, v, p, side, product):
    """Write the function times its side: this is positive as long as the sign has not changed."""
    for lane in range(LANES):
        product[lane] = side[lane] * FUNCTION(t[lane], STATE(u, lane), STATE(v, lane), PARAMS(p, lane))


def compile_event(function: Any, layout: BlockLayout, is_checked: bool = False) -> Lanes:
    """Compile the function of an event for lanes with their own times."""
    return compile_template(watched, function, layout, _EVENT.args, is_checked)


@dataclass(frozen=True)
class Rows:
    """The places of rows in `Block.values`: the rows `names` of the formulas, with `width` values, and of the lanes."""

    names: tuple[str, ...]
    width: int
    lanes: int

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.names) * self.width + len(LaneRows._fields) * self.lanes

    @property
    def times(self) -> slice:
        """The times of the lanes."""
        first = len(self.names) * self.width
        return slice(first, first + self.lanes)

    def views(self) -> dict[str, Any]:
        """Return the elements ``ROWS(values)`` and ``LANE_ROWS(values)``, which return tuples of arrays."""
        firsts = [k * self.width for k in range(len(self.names))]
        of_lanes = [self.times.start + k * self.lanes for k in range(len(LaneRows._fields))]
        return {"ROWS": _views(firsts, self.width), "LANE_ROWS": _views(of_lanes, self.lanes, LaneRows)}


def _views(firsts: Sequence[int], width: int, names: Any = None) -> Any:
    """Return an intrinsic that returns rows of an array, as a tuple or as a NamedTuple."""
    kind = NamedUniTuple(Strip(width), len(firsts), names) if names else UniTuple(Strip(width), len(firsts))

    @intrinsic
    def rows(typingctx, s):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            data = parts_of(context, builder, signature.args[0], args[0]).data
            begins = [builder.gep(data, [context.get_constant(intp, first)]) for first in firsts]
            return context.make_tuple(builder, kind, begins)

        return kind(s), codegen

    return rows


def rows_of(module: str, n: int, lanes: int) -> Rows:
    """Return the rows of a block for the method in a file of `eig3.kernels.methods`."""
    return Rows(tuple(variable_formulas(module).row_names), n * lanes, lanes)


@functools.cache
def adaptive_kernel(module: str, form: Form, n: int, lanes: int, observes: bool) -> Any:
    """Compile `adaptive` for the file of a method with the formulas of a `Pair`, or load it from the disk.

    Without `observes`, the argument `seen` is None.
    """
    pair = variable_formulas(module)
    names: dict[str, Any] = {"N": n, "LANES": lanes, "ORDER": pair.order, "COST": pair.evaluations}
    names |= {"OBSERVES": observes, "OVERFLOWING": _OVERFLOWING, "FAR": _FAR}
    names |= rows_of(module, n, lanes).views() | pair.of_lanes(n, lanes)
    names |= {
        "RHS_AT": _rhs_at,
        "EVENT_AT": _event_at,
        "PROJECT_AT": _project_at,
        "ALONE_AT": form.at("rhs"),
        "BEGIN": beginning(form)[0],
    }
    if observes:
        names |= observing(form, {**names, "ROWS": pair.rows})
    names |= {function.__name__: element(bound(function, names)) for function in (is_full, rest, widen_sizes)}
    names |= {"END": element(bound(end, names)), "BEGIN_LANE": element(bound(begin_lane, names))}
    integers, vector, matrix = Array(int64, 1, "C"), vector_type, matrix_type
    arguments = (
        *(int64, int64, int64, int64),
        SPAN,
        Record((vector, vector, integers, integers, matrix, vector, float64), Block),
        Record((matrix, matrix, matrix, vector, Array(int64, 2, "C")), Trajectories),
        LANE_OBSERVATION if observes else none,
    )
    label = f"{module}_{form.name}_{n}_of_{lanes}_lanes{'_observed' * observes}"
    with wide_vectors():
        return compile_kernel(adaptive, names, int64(*arguments), label)
