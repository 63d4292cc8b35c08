# ruff: noqa: F821
"""Follow the quantities along a step of variable length, and find their extremes within it.

A quantity is evaluated in the middle of a step, on the dense output. If it may have an extreme beyond those so far,
it is evaluated at the other points too. Where the polynomial through these values has an extreme beyond those so far,
the quantity is evaluated there. With points for a polynomial of the order of the method, the polynomial is as accurate
as the step. An error d of the place of a smooth extreme changes its value by d^2 only.
"""

from __future__ import annotations

import functools
from typing import Any

from numba.types import float64, int64, none

from ..compile.jit import bound, called_by_symbol, element, outlined
from ..protocol import COLUMN, HIGH, LOW, OUT, WIDTH, Form, look_within_at, rows, vector_type
from .dense import evaluate, write_up_to
from .follow import functions, widen

# A value goes beyond those at the start, in the middle and at the end by their range at most, if its period is at least
# 1.2 steps. With rtol up to 1e-3, periods have 3 steps or more; the product of two values has periods of 1.5.
_BEYOND_THREE = 1.0
_BEYOND_ALL = 0.75  # the part of the range of the values by which a polynomial of degree 8 at most may go beyond them
_INTERVALS = 2  # parts of the step between two points in which the slope of the polynomial is looked at
_CLOSE = 1e-9  # error of the place of an extreme of the polynomial, relative to the step


def follow_within(place, first, t_end, h, s, n, p):
    """Widen the extremes of the quantities from `first` on by those within a step, and by the values at its end.

    The step has the length h and ends at t_end.

    The look is at the address `place`. The step is the part up to s of the step of the dense output, in `watch.work`.
    The values at its end are in `follow.out`, and stay there.
    """
    look = look_within_at(place)
    follow, within, coefficients = look.follow, look.within, look.watch.work[2:]
    samples, times, last = within.samples, within.times, len(within.points) - 1
    half, dense = last // 2, coefficients
    if s < 1.0:
        dense = within.coefficients
        write_up_to(dense, coefficients, s, n)
    times[last] = t_end
    for k in range(first, len(follow.table)):
        keep_sample(follow, within, k, last)
    for j in range(len(within.before)):
        samples[0, j], within.before[j] = within.before[j], samples[last, j]
    for k in range(first, len(follow.table)):
        SAMPLE(place, k, t_end, h, dense, within.points[half], n, p, half)
        widen_by(place, k, half)
        widen_by(place, k, last)
        if may_go_beyond(place, k, half):
            for m in range(1, last):
                if m != half:
                    SAMPLE(place, k, t_end, h, dense, within.points[m], n, p, m)
            for m in range(1, last):
                widen_by(place, k, m)
            column = follow.table[k, COLUMN]
            for j in range(column, column + max(follow.table[k, WIDTH], 1)):
                REFINE(place, k, j, t_end, h, dense, n, p)
    for k in range(first, len(follow.table)):
        for j in range(max(follow.table[k, WIDTH], 1)):
            follow.out[follow.table[k, OUT] + j] = samples[last, follow.table[k, COLUMN] + j]


@element
def follow_end(follow, within):
    """Take the values in `follow.out` as those at the start of the next step."""
    for k in range(len(follow.table)):
        for j in range(max(follow.table[k, WIDTH], 1)):
            within.before[follow.table[k, COLUMN] + j] = follow.out[follow.table[k, OUT] + j]


@element
def keep_sample(follow, within, k, m):
    """Copy the values of the quantity k to the row m of the samples."""
    for j in range(max(follow.table[k, WIDTH], 1)):
        within.samples[m, follow.table[k, COLUMN] + j] = follow.out[follow.table[k, OUT] + j]


@outlined
def may_go_beyond(place, k, half):
    """Return whether a value may go beyond its extremes between the start, the middle and the end."""
    look = look_within_at(place)
    follow, within = look.follow, look.within
    samples, first = within.samples, follow.table[k, COLUMN]
    for j in range(first, first + max(follow.table[k, WIDTH], 1)):
        a, b, c = samples[0, j], samples[half, j], samples[2 * half, j]
        if is_candidate(min(a, b, c), max(a, b, c), _BEYOND_THREE, within.floors[k], follow.extremes, j):
            return True
    return False


@element
def is_candidate(lowest, highest, beyond, floor, ends, j):
    rise = beyond * (highest - lowest)
    is_beyond = highest + rise > ends[HIGH, j] or lowest - rise < ends[LOW, j]
    return is_beyond and rise > floor * max(abs(lowest), abs(highest))


@outlined
def widen_by(place, k, m):
    """Widen the extremes of the quantity k by the row m of the samples."""
    look = look_within_at(place)
    follow, within = look.follow, look.within
    first = follow.table[k, COLUMN]
    for j in range(first, first + max(follow.table[k, WIDTH], 1)):
        widen(follow.extremes, j, within.samples[m, j], within.times[m])


def sample(place, k, t_end, h, dense, s, n, p, m):
    """Evaluate the quantity k after the fraction s of a step, into the row m of the samples."""
    look = look_within_at(place)
    follow, within = look.follow, look.within
    u, v = rows(within.state, 2)
    evaluate(dense, s, n, u, v)
    within.times[m] = t_end - (1 - s) * h
    EVALUATE_ONE(follow, k, within.times[m], u, v, p)
    keep_sample(follow, within, k, m)


def refine(place, k, j, t_end, h, dense, n, p):
    """Widen the extremes by the values where the polynomial of the value j has extremes beyond those so far."""
    look = look_within_at(place)
    follow, within = look.follow, look.within
    fit, samples, c, ends = within.fit, within.samples, within.c, follow.extremes
    count, extra = len(fit), len(fit)
    lowest = highest = samples[0, j]
    for m in range(1, count):
        lowest, highest = min(lowest, samples[m, j]), max(highest, samples[m, j])
    if not is_candidate(lowest, highest, _BEYOND_ALL, within.floors[k], ends, j):
        return
    for i in range(count):
        c[i] = 0.0
        for m in range(1, count):
            c[i] += fit[i, m] * (samples[m, j] - samples[0, j])
    intervals = _INTERVALS * (count - 1)
    right, slope_right = -1.0, slope(c, count, -1.0)
    for interval in range(1, intervals + 1):
        left, slope_left = right, slope_right
        right = 2 * interval / intervals - 1
        slope_right = slope(c, count, right)
        if slope_left * slope_right < 0 or slope_right == 0:
            x = root_of_slope(c, count, left, right, slope_left)
            value = c[count - 1]
            for i in range(count - 2, -1, -1):
                value = value * x + c[i]
            value += samples[0, j]
            if value > ends[HIGH, j] or value < ends[LOW, j]:
                SAMPLE(place, k, t_end, h, dense, (1 + x) / 2, n, p, extra)
                widen_by(place, k, extra)


@element
def slope(c, count, x):
    """Return the derivative of the polynomial with the coefficients c."""
    total = 0.0
    for k in range(count - 1, 0, -1):
        total = total * x + k * c[k]
    return total


@outlined
def root_of_slope(c, count, left, right, slope_left):
    """Return the zero of the derivative in an interval in which it changes its sign: Newton's method with bisection."""
    x = (left + right) / 2
    while right - left > _CLOSE:
        here, bend = slope(c, count, x), 0.0
        for k in range(count - 1, 1, -1):
            bend = bend * x + k * (k - 1) * c[k]
        if here * slope_left > 0:
            left = x
        else:
            right = x
        better = x - here / bend
        if not left < better < right:
            better = (left + right) / 2
        if abs(better - x) < _CLOSE:
            break
        x = better
    return x


#: The signature of `follow_within`.
OF_FOLLOWING = none(int64, int64, float64, float64, float64, int64, vector_type)


@functools.cache
def following_within(form: Form) -> Any:
    """Return the element `follow_within`."""
    names: dict[str, Any] = {"EVALUATE_ONE": functions(form).evaluate_one}
    names["SAMPLE"] = outlined(bound(sample, names))
    names["REFINE"] = outlined(bound(refine, names))
    return called_by_symbol(follow_within, names, OF_FOLLOWING, form.name)
