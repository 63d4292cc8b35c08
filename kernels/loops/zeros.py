# ruff: noqa: F821
"""Find the zeros of event functions within a step, write them to the log, and apply their resets.

The names in capitals stand for functions that depend on the form of the right-hand side: `functions` inserts them.
"""

from __future__ import annotations

import functools
import math
from typing import Any

from numba.types import Tuple, float64, int64, none

from ..compile.jit import bound, called_by_symbol, element, outlined
from ..protocol import (
    APPLY_ADDRESS,
    DIRECTION,
    ENDED_BY,
    EVENT_VALUES,
    EVENTS,
    FIRST_ROW,
    FOLLOWS_RESETS,
    GAP,
    IS_TERMINAL,
    LOGGED,
    NEXT,
    NOT_A_NUMBER,
    NOT_FINITE,
    NUMBER,
    PART,
    PARTS,
    PASSED,
    QUIET,
    RESET,
    RESTING,
    TERMINAL,
    TOGETHER,
    ZENO,
    Form,
    G,
    look_at,
    matrix_type,
    row_type,
    rows,
    vector_type,
)
from . import follow
from .dense import evaluate

LATER = 4.0  # the step after a reset is at most this multiple of the time since the reset before

EPSILON = 2.0**-52
NEAR = 16  # spacings of t by which the computed time of an event, or t0 + n h, may be wrong
SIDE, LAST, _FREE, _LEVEL = range(EVENT_VALUES)  # the values of an event in the counters, from `EVENTS` on
_DUE, _CROSSING, _END, _HERE = range(4)  # the rows of `Watch.search`
_NEVER = math.inf  # stands for the fraction of the step at which g changes its sign, if it does not
_JUST_AFTER = 2.0**-20  # the fraction of a step after which g has left a zero at the start of the step
_LATER = 8.0  # the multiple of this time at which g is looked at again, to see how it leaves
_GROWTH = 4.0  # g moves on by this factor at least, if what is seen is more than round-off
_SPACINGS, _CLEAR = 4, 4  # spacings of a value that count as round-off; the multiple of it that is certainly a movement
_GOLDEN = 0.6180339887498949  # the golden ratio: the fractions of its multiples are spread evenly
_TOGETHER = 4  # events within this multiple of the tolerance of a root occur at the same time
_LEAST_GAP = 2.0**-43  # a reset that follows another within this part of the time is the last one
_OVERFLOWING = 1e100  # g and resets may overflow for states larger than this, even if they are correct
_SPREAD = 0.2  # the parameter kappa_1 of the ITP method, relative to the first interval; it has little effect

_step, _state = (int64, vector_type, float64, float64, float64), (row_type,) * 2

#: The signatures of `look_within` and of `write_time`.
OF_SEARCH = Tuple((int64, float64, float64))(*_step, float64, int64, matrix_type, *_state, *_state, vector_type)
OF_TIMES = none(*_step, int64, matrix_type, *_state, vector_type)


def is_quiet(watch, counters, t, u, v, p):
    """Return whether every g still has its sign."""
    k = 0
    while k < len(watch.events):
        count, side = watch.events[k, TOGETHER], EVENTS + EVENT_VALUES * k + SIDE
        if count > 1:
            address, first = watch.events[k, QUIET], watch.events[k, NUMBER]
            if QUIET_AT(address)(first, count, side, counters, t, u, v, p) == 0:
                return False
        elif not EVENT_AT(watch.events[k, G])(t, u, v, p) * counters[side] > 0:
            return False
        k += count
    return True


def quiet_together(first, count, side, counters, t, u, v, p):
    """Return 1 if every g of neighbouring members of a family still has its sign, else 0.

    What the members have in common is read once. The product is not positive for zero and for NaN.
    """
    for k in range(count):
        if not FUNCTION(float(first + k), t, u, v, p) * counters[side + EVENT_VALUES * k] > 0:
            return 0
    return 1


def look_within(place, counters, t0, t, h, t_end, n, coefficients, u_end, v_end, u, v, p):
    """Process the events of a step in their order, up to the first that resets the state or ends the run.

    The look is at the address `place`, and the run began at t0. `coefficients` are the dense output of the step from t
    to t_end, and u_end and v_end the state at its end. Return the outcome, and the fraction s of the step and the time
    at which it ends: the compiler may round t + s h in two ways if it is computed twice. If the outcome is not PASSED,
    u and v are changed to the state there. They are scratch otherwise. A step to a state that is not finite has no
    events: the run diverges.
    """
    watch = look_at(place).watch
    count, search, size = len(watch.events), watch.search, size_of(u_end, v_end, n)
    if not size < math.inf:
        return PASSED, 1.0, t_end
    tolerance = 2 * EPSILON * max(abs(t), abs(t_end)) / h
    for k in range(count):
        mine = EVENTS + EVENT_VALUES * k
        g_end = EVENT(watch.events[k, G], t_end, u_end, v_end, p)
        if g_end != g_end:
            counters[ENDED_BY] = k
            return (NOT_A_NUMBER, 0.0, t) if size < _OVERFLOWING else (PASSED, 1.0, t_end)
        crossing, side = _NEVER, counters[mine + SIDE]
        if not _is_unwanted(watch.events[k, DIRECTION], side):
            crossing, side = CROSSING(place, counters, k, 1.0, g_end, t, h, n, coefficients, u, v, p, tolerance)
        if crossing < 0:
            counters[ENDED_BY] = k
            return RESTING, 0.0, t
        is_unwanted = _is_unwanted(watch.events[k, DIRECTION], side)
        search[_CROSSING, k], search[_DUE, k] = crossing, _NEVER if is_unwanted else crossing
        search[_END, k], counters[mine + SIDE] = g_end, side
        if side != 0:
            counters[mine + _FREE] = 0.0
    outcome, s, stop, near = PASSED, 1.0, t_end, _TOGETHER * tolerance
    if _earliest(search[_DUE], count) >= 0:  # where other events matter only if they are at the same time
        for k in range(count):
            side = counters[EVENTS + EVENT_VALUES * k + SIDE]
            if _is_unwanted(watch.events[k, DIRECTION], side) and search[_CROSSING, k] == _NEVER:
                search[_CROSSING, k], _ = CROSSING(
                    place, counters, k, 1.0, search[_END, k], t, h, n, coefficients, u, v, p, tolerance
                )
    while True:
        k = _earliest(search[_DUE], count)
        if k < 0 or search[_DUE, k] > (1.0 if outcome == PASSED else s + near):
            break
        if outcome == PASSED:
            s = search[_DUE, k]
            if s < 1.0:
                stop = t + s * h
                evaluate(coefficients, s, n, u, v)
            else:
                stop = t_end
                for j in range(n):
                    u[j], v[j] = u_end[j], v_end[j]
            for other in range(count):
                search[_HERE, other] = EVENT(watch.events[other, G], stop, u, v, p)
            is_first = True
            for other in range(count if size < _OVERFLOWING else 0):
                side, here = counters[EVENTS + EVENT_VALUES * other + SIDE], search[_HERE, other]
                has_crossed = here * side < 0 and search[_CROSSING, other] > s + near
                matters = _may_stop(watch, k) or _may_stop(watch, other)  # g changes its sign again after s
                if has_crossed and matters and not _is_unwanted(watch.events[other, DIRECTION], side):
                    crossing, _ = CROSSING(place, counters, other, s, here, t, h, n, coefficients, u, v, p, tolerance)
                    search[_CROSSING, other], is_first = crossing, False
                    if crossing > near:  # otherwise g was at its zero at the start
                        search[_DUE, other] = crossing
            if not is_first:
                continue
        outcome = max(outcome, TAKE(place, counters, k, t0, stop, n, u, v, p))
        search[_DUE, k] = _NEVER
    if outcome == PASSED:
        for k in range(count):
            mine = EVENTS + EVENT_VALUES * k
            if search[_END, k] != 0 and counters[mine + _FREE] == 0:
                counters[mine + SIDE] = search[_END, k]
        return outcome, 1.0, t_end
    if outcome == RESET:
        for k in range(count):
            if watch.events[k, FOLLOWS_RESETS] != 0 and abs(search[_CROSSING, k] - s) > near:
                here, g = search[_HERE, k], EVENT(watch.events[k, G], stop, u, v, p)
                if here * g < 0 and not _is_unwanted(watch.events[k, DIRECTION], here):
                    outcome = max(outcome, TAKE(place, counters, k, t0, stop, n, u, v, p))
    for k in range(count):
        is_crossing = abs(search[_CROSSING, k] - s) <= near
        _note_side(search, counters, k, is_crossing, EVENT(watch.events[k, G], stop, u, v, p))
    return outcome, s, stop


@element
def size_of(u, v, n):
    """Return the sum of |u| and |v|. It is not below infinity if one of them is infinite or NaN."""
    total = 0.0
    for j in range(n):
        total += abs(u[j]) + abs(v[j])
    return total


@element
def _earliest(due, count):
    """Return the event that is due first, or -1."""
    earliest, least = -1, _NEVER
    for k in range(count):
        if due[k] < least:
            earliest, least = k, due[k]
    return earliest


@element
def _note_side(search, counters, k, is_crossing, g):
    """Note the sign of `g`, which is the g of the event k after the resets.

    An event that `is_crossing` is at its zero, on whichever side round-off puts it, unless a reset moved it away: the
    next step then shows its sign. So it does if a reset moved g to zero. If g is zero by itself, it keeps its sign.
    """
    mine = EVENTS + EVENT_VALUES * k
    here = search[_HERE, k]
    if abs(g) > (2 * abs(here) if is_crossing else 0.0):
        counters[mine + SIDE] = g
    elif is_crossing or here != 0:
        counters[mine + SIDE], counters[mine + _LEVEL] = 0.0, g
    if not is_crossing or counters[mine + SIDE] != 0:
        counters[mine + _FREE] = 0.0


@element
def _may_stop(watch, k):
    """Return whether the step ends at an occurrence of the event k."""
    return watch.events[k, APPLY_ADDRESS] != 0 or watch.events[k, IS_TERMINAL] != 0


@element
def _is_unwanted(direction, side):
    """Return whether a change of sign from this side of zero is in the other direction than wanted."""
    return side != 0 and direction == (1 if side > 0 else -1)


def crossing_within(place, counters, k, high, g_high, t, h, n, coefficients, u, v, p, tolerance):
    """Return the fraction of the step at which g of the event k changes its sign, or `_NEVER`, and the sign before.

    The change is before the fraction `high`, with g there `g_high`. If the sign at the start is zero, `high` is 1.

    The counters have the sign of g at the start. If it is zero, the sign is that just after the start. They also have
    the sign from which the last reset of the event came, if it left g at zero, and otherwise zero. If g then leaves to
    the other side with the rate 0, it rests on its zero: -1 is returned as the fraction.

    The ITP method takes at most one more evaluation than bisection, and as few as the secant method if g is smooth:
    I. F. D. Oliveira and R. H. C. Takahashi, ACM Transactions on Mathematical Software 47 (2020), 5.
    """
    address, mine = look_at(place).watch.events[k, G], EVENTS + EVENT_VALUES * k
    side = counters[mine + SIDE]
    low, is_known = 0.0, abs(side) > 0
    if not is_known:
        free, level, since = counters[mine + _FREE], counters[mine + _LEVEL], t - counters[mine + LAST]
        low, g_low, side = DEPARTURE(address, free, level, since, g_high, t, h, n, coefficients, u, v, p, tolerance)
    if low < 0:
        return low, side
    is_rising = side < 0
    has_changed = g_high > 0 if is_rising else g_high < 0  # after a zero at the end, the next step shows it
    if side == 0 or not has_changed:
        return _NEVER, side
    if is_known:
        evaluate(coefficients, low, n, u, v)
        g_low = EVENT(address, t, u, v, p)
    if g_low == 0 or (g_low < 0) != is_rising:  # zero, up to round-off
        return low, side
    spread, radius = _SPREAD / (high - low), high - low
    while high - low > 2 * tolerance:
        middle, half = (low + high) / 2, (high - low) / 2
        secant = (g_high * low - g_low * high) / (g_high - g_low)
        side_of_root = 1.0 if middle > secant else -1.0
        shift = spread * (high - low) * (high - low)
        x = secant + side_of_root * shift if shift <= abs(middle - secant) else middle
        if abs(x - middle) > radius - half:
            x = middle - side_of_root * (radius - half)
        radius /= 2
        if not low < x < high:
            x = middle
            if not low < x < high:
                break
        evaluate(coefficients, x, n, u, v)
        g = EVENT(address, t + x * h, u, v, p)
        if (g < 0) == is_rising and g != 0:
            low, g_low = x, g
        else:
            high, g_high = x, g
    return high, side


def departure(address, free, level, since, g_end, t, h, n, coefficients, u, v, p, tolerance):
    """Return a fraction of the step at which g has left its zero, g there, and the sign that it got.

    The sign is zero if g does not leave it. The fraction is -1 if g rests on its zero: see `crossing_within`. After a
    reset, at the time `since` before the step, g was `level`. With a rate, g leaves it as this time; from rest, it
    leaves it as the square of the time at least.
    """
    evaluate(coefficients, 0.0, n, u, v)
    g_start = EVENT(address, t, u, v, p)  # on either side of zero, by round-off
    noise = _CLEAR * ROUND_OFF(address, t, n, coefficients, g_start, u, v, p)
    if free == 0:
        level, since = g_start, 0.0
    s, sign = _JUST_AFTER, 0.0
    while True:
        is_last = _LATER * s == 1.0
        evaluate(coefficients, s, n, u, v)
        g = EVENT(address, t + s * h, u, v, p)
        g_later = g_end
        if not is_last:
            evaluate(coefficients, _LATER * s, n, u, v)
            g_later = EVENT(address, t + _LATER * s * h, u, v, p)
        moved, moved_later = g - level, g_later - level
        ratio = (since + _LATER * s * h) / (since + s * h)
        from_rest = ratio * math.sqrt(ratio) * max(abs(moved), noise)
        is_seen = abs(moved) > noise and (noise > 0 or abs(moved_later) >= _GROWTH * abs(moved))
        has_left = is_seen and g * moved > 0 and moved * moved_later > 0
        if has_left or (is_last and abs(moved) <= noise and abs(moved_later) > from_rest):
            sign = moved_later
            break
        if is_last:
            break
        s *= 2
    if sign * free < 0 and g_end * free > 0:  # the polynomial of a step over a jump of the force dips, not the motion
        return s, g, free
    if not sign * free < 0 or abs(moved_later) <= from_rest:
        return s, g, sign
    while s > tolerance:
        s /= 2
        evaluate(coefficients, s, n, u, v)
        g = EVENT(address, t + s * h, u, v, p)
        if g * free > 0 and (g - level) * free > noise:  # it has risen, and fallen back
            return s, g, free
    return -1.0, g, free


def round_off(address, t, n, coefficients, g, u, v, p):
    """Return about the change of g at the start of a step by round-off of t, u and v, of some spacings in each value.

    The changes have signs as if by chance, so that they do not cancel in differences of two values.
    """
    most = 0.0
    for bit in range(3):
        evaluate(coefficients, 0.0, n, u, v)
        for j in range(n):
            chance = (j * _GOLDEN) % 1.0
            change = _SPACINGS * EPSILON * (1 - 2 * (int64(chance * 2.0 ** (bit + 1)) % 2))
            u[j] *= 1 + change
            v[j] *= 1 + change
        most = max(most, abs(EVENT(address, t * (1 + _SPACINGS * EPSILON), u, v, p) - g))
    return most


def take(place, counters, k, t0, t, n, u, v, p):
    """Write an occurrence of the event k to the log, apply its reset to u and v, and return the outcome.

    The quantities are followed in the state before and in the state after the reset.
    """
    watch, part = look_at(place).watch, int64(counters[PART]) % PARTS
    row, address = watch.log[int64(counters[LOGGED])], watch.events[k, APPLY_ADDRESS]
    mine = EVENTS + EVENT_VALUES * k
    counters[LOGGED] += 1
    row[0], row[1] = k, t
    outcome, size = PASSED, size_of(u, v, n)
    for j in range(n):
        row[2 + j], row[2 + n + j] = u[j], v[j]
    FOLLOW(place, part, t, u, v, p)
    if address != 0:
        APPLY(address, t, u, v, p)
        counters[mine + _FREE] = 0.0
        for j in range(n):
            if u[j] != row[2 + j] or v[j] != row[2 + n + j]:
                counters[mine + _FREE] = counters[mine + SIDE]
            if (u[j] - u[j] != 0 and row[2 + j] - row[2 + j] == 0) or (
                v[j] - v[j] != 0 and row[2 + n + j] - row[2 + n + j] == 0
            ):
                outcome = NOT_FINITE if size < _OVERFLOWING else outcome
        if outcome == PASSED:
            FOLLOW(place, part, t, u, v, p)
        counters[GAP] = t - counters[mine + LAST]
        counters[mine + LAST] = t
        outcome = max(outcome, RESET if counters[GAP] > _LEAST_GAP * max(abs(t), abs(t0)) else ZENO)
    for j in range(n):
        row[2 + 2 * n + j], row[2 + 3 * n + j] = u[j], v[j]
    if watch.events[k, IS_TERMINAL] != 0:
        outcome = max(outcome, TERMINAL)
    if outcome >= TERMINAL:
        counters[ENDED_BY] = k
    return outcome


def write_time(place, counters, t, h, t_end, n, coefficients, u_end, v_end, p):
    """Write the state at the next of `watch.times`, and the values of the outputs there."""
    look, k = look_at(place), int64(counters[NEXT])
    watch, row = look.watch, int64(counters[FIRST_ROW]) + k
    (u,), (v,) = rows(watch.u_rows[row:], 1), rows(watch.v_rows[row:], 1)
    if watch.times[k] == t_end:
        for j in range(n):
            u[j], v[j] = u_end[j], v_end[j]
    else:
        evaluate(coefficients, (watch.times[k] - t) / h, n, u, v)
    watch.h_rows[row] = h
    EVALUATE(look.follow, look.follow.invariants, watch.times[k], u, v, p)
    follow.save(look.follow, row)
    counters[NEXT] += 1


def followed(place, part, t, u, v, p):
    """Evaluate the quantities in a state, and widen their extremes."""
    quantities = look_at(place).follow
    EVALUATE(quantities, 0, t, u, v, p)
    WIDEN(quantities, 0, part, t, v)


@functools.cache  # so that kernels share the compiled elements
def quiet(form: Form) -> Any:
    """Return the element `is_quiet` for one form of right-hand side."""
    return element(bound(is_quiet, {"EVENT_AT": form.at("invariant"), "QUIET_AT": form.at("quiet")}))


@functools.cache
def search_of_step(form: Form) -> Any:
    """Return the element `look_within`."""
    apply_at = form.at("apply")
    apply = element(lambda address, t, u, v, p: apply_at(address)(t, u, v, p))
    names: dict[str, Any] = {
        "EVENT": event_of(form),
        "APPLY": apply,
        "EVALUATE": follow.functions(form).evaluate,
        "WIDEN": follow.widen_all,
    }
    names["FOLLOW"] = outlined(bound(followed, names))
    names["ROUND_OFF"] = outlined(bound(round_off, names))
    names["DEPARTURE"] = outlined(bound(departure, names))
    names["CROSSING"] = outlined(bound(crossing_within, names))
    names["TAKE"] = outlined(bound(take, names))
    return called_by_symbol(look_within, names, OF_SEARCH, form.name)


@functools.cache
def writing_of_times(form: Form) -> Any:
    """Return the element `write_time`."""
    return called_by_symbol(write_time, {"EVALUATE": follow.functions(form).evaluate}, OF_TIMES, form.name)


def event_of(form: Form) -> Any:
    """Return the element ``event(address, t, u, v, p)``, which calls the function of an event."""
    event_at = form.at("invariant")
    return element(lambda address, t, u, v, p: event_at(address)(t, u, v, p))
