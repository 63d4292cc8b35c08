# ruff: noqa: F821
"""Find the zeros of event functions within a step, write them to the log, and apply their resets.

The names in capitals stand for functions that depend on the form of the right-hand side: `functions` inserts them.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace
from typing import Any

from .dense import evaluate
from .jit import bound, element, outlined
from .protocol import ENDED_BY, EVENTS, GAP, LOGGED, NEXT, SCALAR, Form, function_at

#: What became of a step with events. A later one of these outcomes takes precedence.
PASSED, RESET, TERMINAL, ZENO, NOT_A_NUMBER, APPLIED_NAN = range(6)

EPSILON = 2.0**-52
_G, _APPLY, _DIRECTION, _IS_TERMINAL = range(4)  # the columns of `Watch.events`
_NEVER = 2.0  # stands for the fraction of the step at which an event occurs, if it does not
_JUST_AFTER = 2.0**-20  # the fraction of a step after which g has left a zero at the start of the step
_TOGETHER = 4  # events within this multiple of the tolerance of a root occur at the same time
_SPREAD = 0.2  # the parameter kappa_1 of the ITP method, relative to the first interval; it has little effect


def is_quiet(watch, tally, t, u, v, p):
    """Return whether every g still has its sign. A product is used, because it is false for zero and for NaN."""
    for k in range(len(watch.events)):  # noqa: SIM110  Numba compiles no generator
        if not EVENT(watch.events[k, _G], t, u, v, p) * tally[EVENTS + 2 * k] > 0:
            return False
    return True


def look_within(watch, tally, t, h, t_end, n, coefficients, u_end, v_end, u, v, p):
    """Process the events of a step in their order, up to the first that resets the state or ends the run.

    `coefficients` are the dense output of the step from t to t_end, and u_end and v_end the state at its end. Return
    the outcome and the fraction s of the step at which it ends. If the outcome is not PASSED, u and v are changed to
    the state there. They are scratch otherwise.
    """
    count = len(watch.events)
    roots, ends = watch.work[0], watch.work[1]
    roots[0] = _NEVER  # if there are no events, but only wanted times
    tolerance = 2 * EPSILON * max(abs(t), abs(t_end)) / h
    for k in range(count):
        ends[k] = EVENT(watch.events[k, _G], t_end, u_end, v_end, p)
        roots[k], before = ROOT(
            watch.events[k, _G],
            watch.events[k, _DIRECTION],
            tally[EVENTS + 2 * k],
            ends[k],
            t,
            h,
            n,
            coefficients,
            u,
            v,
            p,
            tolerance,
        )
        if ends[k] != ends[k]:
            tally[ENDED_BY] = k
            return NOT_A_NUMBER, 1.0
        tally[EVENTS + 2 * k] = before
    outcome, s = PASSED, 1.0
    while True:
        k = _earliest(roots, count)
        if roots[k] > (1.0 if outcome == PASSED else s + _TOGETHER * tolerance):
            break
        if outcome == PASSED:
            s = roots[k]
            if s < 1.0:
                evaluate(coefficients, s, n, u, v)
            else:
                for j in range(n):
                    u[j], v[j] = u_end[j], v_end[j]
        outcome = max(outcome, TAKE(watch, tally, k, t + s * h if s < 1.0 else t_end, n, ends, u, v, p))
        roots[k] += _NEVER
    if outcome == PASSED:
        s = 1.0
    for k in range(count):
        if outcome == PASSED:
            tally[EVENTS + 2 * k] = ends[k] if ends[k] != 0 else tally[EVENTS + 2 * k]
        elif roots[k] - _NEVER >= s - _TOGETHER * tolerance:  # it has just occurred
            tally[EVENTS + 2 * k] = ends[k] if watch.events[k, _APPLY] != 0 else 0.0
        else:
            tally[EVENTS + 2 * k] = EVENT(watch.events[k, _G], t + s * h, u, v, p)
    return outcome, s


@element
def _earliest(roots, count):
    earliest = 0
    for k in range(1, count):
        if roots[k] < roots[earliest]:
            earliest = k
    return earliest


def root_within(address, direction, before, g_end, t, h, n, coefficients, u, v, p, tolerance):
    """Return the fraction of the step at which g changes its sign in the wanted direction, or `_NEVER`.

    `before` has the sign of g at the start. If it is zero, it gets the sign just after the start. It is returned too.

    The ITP method takes at most one more evaluation than bisection, and as few as the secant method if g is smooth:
    I. F. D. Oliveira and R. H. C. Takahashi, ACM Transactions on Mathematical Software 47 (2020), 5.
    """
    low, high = 0.0, 1.0
    evaluate(coefficients, low, n, u, v)
    g_low, g_high = EVENT(address, t, u, v, p), g_end
    if before == 0:
        g_start, low = g_low, _JUST_AFTER
        evaluate(coefficients, low, n, u, v)
        g_low = EVENT(address, t + low * h, u, v, p)
        before = g_low - g_start  # g_start may be on either side of zero, by round-off
        while low < 0.5 and not g_low * before > 0:
            low *= 2
            evaluate(coefficients, low, n, u, v)
            g_low = EVENT(address, t + low * h, u, v, p)
    is_rising = before < 0
    has_changed = g_end > 0 if is_rising else g_end < 0  # after a zero at the end, the next step shows it
    if before == 0 or not has_changed or direction == (-1 if is_rising else 1):
        return _NEVER, before
    if g_low == 0 or (g_low < 0) != is_rising:  # zero, up to round-off
        return low, before
    spread, radius = _SPREAD / (high - low), high - low
    while high - low > 2 * tolerance:
        middle, half = (low + high) / 2, (high - low) / 2
        secant = (g_high * low - g_low * high) / (g_high - g_low)
        side = 1.0 if middle > secant else -1.0
        shift = spread * (high - low) * (high - low)
        x = secant + side * shift if shift <= abs(middle - secant) else middle
        if abs(x - middle) > radius - half:
            x = middle - side * (radius - half)
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
    return high, before


def take(watch, tally, k, t, n, ends, u, v, p):
    """Write an occurrence of the event k to the log, apply its reset to u and v, and return the outcome.

    The value of g after a reset that moves it away from zero is written to `ends`. If g stays where it is, which is
    zero up to round-off, zero is written: the next step then shows the sign that it gets.
    """
    row, address = watch.log[int(tally[LOGGED])], watch.events[k, _APPLY]
    tally[LOGGED] += 1
    row[0], row[1] = k, t
    outcome = PASSED
    for j in range(n):
        row[2 + j], row[2 + n + j] = u[j], v[j]
    if address != 0:
        g = EVENT(watch.events[k, _G], t, u, v, p)
        APPLY(address, t, u, v, p)
        g_after = EVENT(watch.events[k, _G], t, u, v, p)
        for j in range(n):
            if u[j] != u[j] or v[j] != v[j]:
                outcome = APPLIED_NAN
        ends[k] = g_after if abs(g_after) > 2 * abs(g) else 0.0
        tally[GAP] = t - tally[EVENTS + 2 * k + 1]
        tally[EVENTS + 2 * k + 1] = t
        outcome = max(outcome, RESET if tally[GAP] > watch.zeno else ZENO)
    for j in range(n):
        row[2 + 2 * n + j], row[2 + 3 * n + j] = u[j], v[j]
    if watch.events[k, _IS_TERMINAL] != 0:
        outcome = max(outcome, TERMINAL)
    if outcome >= TERMINAL:
        tally[ENDED_BY] = k
    return outcome


@outlined
def write_time(watch, tally, t, h, t_end, n, coefficients, u_end, v_end):
    """Write the state at the next of `watch.times`."""
    row = int(tally[NEXT])
    u, v = watch.u_rows[row], watch.v_rows[row]
    if watch.times[row] == t_end:
        for j in range(n):
            u[j], v[j] = u_end[j], v_end[j]
    else:
        evaluate(coefficients, (watch.times[row] - t) / h, n, u, v)
    watch.h_rows[row] = h
    tally[NEXT] += 1


@functools.cache  # so that kernels share the compiled elements
def functions(form: Form) -> SimpleNamespace:
    """Return the elements for one form of right-hand side.

    `accelerate`, `is_quiet` and `look_within` take a state as rows of n values, also for one degree of freedom.
    `is_quiet_now` takes it as the right-hand side does.
    """
    event_at, apply_at = function_at(form.invariant), function_at(form.apply)
    event_now = element(lambda address, t, u, v, p: event_at(address)(t, u, v, p))
    event_of_row = element(lambda address, t, u, v, p: event_at(address)(t, u[0], v[0], p))
    event = event_of_row if form is SCALAR else event_now
    apply = element(bound(_apply_scalar if form is SCALAR else _apply_vector, {"APPLY_AT": apply_at}))
    names: dict[str, Any] = {"EVENT": event, "APPLY": apply}
    names["ROOT"] = outlined(bound(root_within, names))
    names["TAKE"] = outlined(bound(take, names))
    return SimpleNamespace(
        accelerate=element(_accelerate_scalar if form is SCALAR else _accelerate_vector),
        is_quiet=element(bound(is_quiet, names)),
        is_quiet_now=element(bound(is_quiet, {"EVENT": event_now})),
        look_within=outlined(bound(look_within, names)),
    )


def _accelerate_scalar(f, t, u, v, p, a):
    a[0] = f(t, u[0], v[0], p)


def _accelerate_vector(f, t, u, v, p, a):
    f(t, u, v, p, a)


def _apply_scalar(address, t, u, v, p):
    u[0], v[0] = APPLY_AT(address)(t, u[0], v[0], p)


def _apply_vector(address, t, u, v, p):
    APPLY_AT(address)(t, u, v, p)
