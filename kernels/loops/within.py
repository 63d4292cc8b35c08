# ruff: noqa: F821
"""The kernel that evaluates a quantity along steps of variable length, and finds its extremes within them.

The quantity is evaluated in the middle of a step, on the dense output. If it may have an extreme beyond those so far,
it is evaluated at the other points too. Where the polynomial through these values has an extreme beyond those so far,
the quantity is evaluated there. With points for a polynomial of the order of the method, the polynomial is as accurate
as the step. An error d of the place of a smooth extreme changes its value by d^2 only.
"""

import functools
from typing import Any

from numba.types import Array, float64, int64, none

from ..compile.jit import bound, compile_kernel, element, outlined
from ..protocol import SCALAR, Form, function_at, matrix_type, vector_type
from .dense import evaluate
from .quantity import HIGH, LOW, evaluation, widen

# A value goes beyond those at the start, in the middle and at the end by their range at most, if its period is at least
# 1.2 steps. With rtol up to 1e-3, periods have 3 steps or more, and those of a product of two values 1.5.
_BEYOND_THREE = 1.0
_BEYOND_ALL = 0.75  # the part of the range of the values by which a polynomial of degree 8 at most may go beyond them
_CELLS = 2  # parts of the step between two points in which the slope of the polynomial is looked at
_CLOSE = 1e-9  # error of the place of an extreme of the polynomial, relative to the step


def extent_within(
    address, p, t, h, u_rows, v_rows, dense, points, fit, floor, before, samples, times, c, state, out, values, ends
):
    function, n, last = FUNCTION(address), u_rows.shape[1], len(points) - 1
    half = last // 2
    for i in range(len(t)):
        EVALUATE(function, t[i], STATE(u_rows[i]), STATE(v_rows[i]), p, out, samples, last)
        times[last] = t[i]
        is_step = h[i] > 0 and (i == 0 or t[i] > t[i - 1])  # if not, the row is the state after a reset
        if is_step:
            for j in range(out.size):
                samples[0, j] = before[j]
            SAMPLE(function, t[i], h[i], dense[i], points[half], n, p, out, samples, times, half, state)
            widen_by(samples, times, half, half + 1, ends)
        widen_by(samples, times, last, last + 1, ends)
        if is_step and may_go_beyond(samples, half, floor, ends):
            for m in range(1, last):
                if m != half:
                    SAMPLE(function, t[i], h[i], dense[i], points[m], n, p, out, samples, times, m, state)
            widen_by(samples, times, 1, last, ends)
            for j in range(out.size):
                REFINE(function, t[i], h[i], dense[i], j, n, p, fit, floor, out, samples, times, c, state, ends)
        for j in range(out.size):
            before[j] = values[i, j] = samples[last, j]


@outlined
def may_go_beyond(samples, half, floor, ends):
    """Return whether a value may go beyond its extremes between the start, the middle and the end."""
    for j in range(samples.shape[1]):
        a, b, c = samples[0, j], samples[half, j], samples[2 * half, j]
        if is_candidate(min(a, b, c), max(a, b, c), _BEYOND_THREE, floor, ends, j):
            return True
    return False


@element
def is_candidate(lowest, highest, beyond, floor, ends, j):
    rise = beyond * (highest - lowest)
    is_beyond = highest + rise > ends[HIGH, j] or lowest - rise < ends[LOW, j]
    return is_beyond and rise > floor * max(abs(lowest), abs(highest))


@outlined
def widen_by(samples, times, first, end, ends):
    """Widen the extremes by some rows of samples."""
    for j in range(samples.shape[1]):
        widen(samples[first:end], j, times[first:end], ends)


def sample(function, t_end, h, dense, s, n, p, out, samples, times, m, state):
    """Evaluate the function after the fraction s of a step, into the row m of `samples` and `times`."""
    u, v = state[0], state[1]
    evaluate(dense, s, n, u, v)
    times[m] = t_end - (1 - s) * h
    EVALUATE(function, times[m], STATE(u), STATE(v), p, out, samples, m)


def refine(function, t_end, h, dense, j, n, p, fit, floor, out, samples, times, c, state, ends):
    """Widen the extremes by the values where the polynomial of the value j has extremes beyond those so far."""
    count, extra = len(fit), len(fit)
    lowest = highest = samples[0, j]
    for m in range(1, count):
        lowest, highest = min(lowest, samples[m, j]), max(highest, samples[m, j])
    if not is_candidate(lowest, highest, _BEYOND_ALL, floor, ends, j):
        return
    for k in range(count):
        c[k] = 0.0
        for m in range(1, count):
            c[k] += fit[k, m] * (samples[m, j] - samples[0, j])
    cells = _CELLS * (count - 1)
    right, slope_right = -1.0, slope(c, count, -1.0)
    for cell in range(1, cells + 1):
        left, slope_left = right, slope_right
        right = 2 * cell / cells - 1
        slope_right = slope(c, count, right)
        if slope_left * slope_right < 0 or slope_right == 0:
            x = root_of_slope(c, count, left, right, slope_left)
            value = c[count - 1]
            for k in range(count - 2, -1, -1):
                value = value * x + c[k]
            value += samples[0, j]
            if value > ends[HIGH, j] or value < ends[LOW, j]:
                SAMPLE(function, t_end, h, dense, (1 + x) / 2, n, p, out, samples, times, extra, state)
                widen_by(samples, times, extra, extra + 1, ends)


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


@functools.cache
def extent_within_kernel(form: Form, writes: bool) -> Any:
    """Compile the kernel, or load it from the disk.

    It is called as ``kernel(address, p, t, h, u_rows, v_rows, dense, points, fit, floor, before, samples, times, c,
    state, out, values, ends)``, for rows of states of n values each, the steps h that led there, and the dense output
    of these steps. The function at this address has k values in each row: they are written to `values`, and widen the
    extremes `ends`, see `eig3.kernels.loops.quantity`. A row with the time of the row before is a state after a reset,
    without a step.

    `points` are fractions of the step, from 0 to 1, with 1/2 in the middle. The matrix `fit` gives the coefficients of
    the polynomial in 2 s - 1 from the values there. Changes within a step of at most the part `floor` of a value are
    not looked at. `before` has the k values before the first row, and then those of the last row. `samples` and
    `times` have a row for each point and one more, and `c` and `state` are for the coefficients of the polynomial and
    for u and v.

    Parameters
    ----------
    form : Form
    writes : bool
        Whether the function writes its values. If not, it returns its only value.
    """
    names = {"FUNCTION": function_at(form.output if writes else form.invariant), "EVALUATE": evaluation(writes)}
    names["STATE"] = element(_only if form is SCALAR else _row)
    names["SAMPLE"] = outlined(bound(sample, names))
    names["REFINE"] = outlined(bound(refine, names))
    rows = *(vector_type,) * 2, *(matrix_type,) * 2, Array(float64, 3, "C")
    samples = vector_type, matrix_type, float64, vector_type, matrix_type, *(vector_type,) * 2, matrix_type
    signature = none(int64, vector_type, *rows, *samples, vector_type, *(matrix_type,) * 2)
    return compile_kernel(extent_within, names, signature, f"{form.name}_{'written' if writes else 'returned'}")


def _only(u):
    return u[0]


def _row(u):
    return u
