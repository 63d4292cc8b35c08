"""CD, the central difference method, for a force that depends on velocity: fixed-point iteration for v_n.

A step computes the same values as a step of `cd_newton`. It repeats v = w + h/2 f(t, u, v) until v no longer changes.
The first v uses the acceleration of the last step. The iteration converges if h/2 |df/dv| < 1. It needs no Jacobian,
and is cheaper than Newton's method if h/2 |df/dv| is small.
"""

import math

from ..compile.jit import element
from ..protocol import DEGREE, EVALUATIONS, ITERATIONS, RESIDUAL
from .cd_newton import first_not_finite, is_solved, move, start

__all__ = ["PAST", "ROWS", "constants", "start", "step"]

PAST, ROWS = 1, 7


@element
def constants(settings, h, work):
    return settings[0], int(settings[1]), work.counters


@element
def step(f, at, y, c, n):
    u, v, w, u_next, v_next, w_next, a = y
    tolerance, limit, counters = c
    for j in range(n):
        impulse = v[j] - w[j]
        u_next[j], w_next[j] = move(u[j], v[j], w[j], at.h)
        v_next[j] = w_next[j] + impulse
    last = math.nan
    for _ in range(limit):
        f(at.t + at.h, u_next, v_next, at.p, a)
        counters[EVALUATIONS] += 1
        counters[ITERATIONS] += 1
        change = scale = size = 0.0
        for j in range(n):
            v_iterated = w_next[j] + at.h / 2 * a[j]
            change += abs(v_iterated - v_next[j])  # a sum, because a maximum may ignore a NaN
            scale += abs(v_iterated) + abs(w_next[j])
            size += abs(u_next[j])
            v_next[j] = v_iterated
        if not math.isfinite(change + scale + size):
            break
        if is_solved(change, last, scale, size, tolerance, at.h, n):
            return (u_next, v_next, w_next, u, v, w, a), True
        last = change
    counters[RESIDUAL], counters[DEGREE] = last, first_not_finite(v_next, n)
    return y, False  # rows u, v and w still hold the last good state
