"""CD, the central difference method, for a force that depends on velocity: Newton's method for v_n.

    w_{n+1} = 2 v_n - w_n        u_{n+1} = u_n + h w_{n+1}        solve  v = w + h/2 f(t, u, v)  for v_{n+1}

with w_n = (u_n - u_{n-1}) / h, so that u_{n+1} = u_{n-1} + 2 h v_n. Newton's method starts from the v of the last step.
It factorises I - h/2 df/dv by LDU with rook pivoting, as in the article. df/dv comes from the user's `jacobian` or from
differences of f. After the residual has passed the tolerance, the last factors correct v once more with this residual.
This costs no evaluation. Without the correction, the remaining errors, which have the same sign in all steps, would add
up over 1e7 steps.
"""

import math

from ..compile.jit import element
from ..protocol import DEGREE, EVALUATIONS, ITERATIONS, RESIDUAL
from . import ldu

PAST, ROWS, MATRIX = 1, 11, True

ROUND_OFF = 2.0**-50  # four units in the last place of 1.0
DENORMAL_ROUND_OFF = 2.0**-1072  # four units in the last place of a denormal number, the same for all of them
RELATIVE_INCREMENT = 2.0**-26  # square root of the machine epsilon: truncation and round-off errors are then similar
SMALLEST_NORMAL = 2.0**-1022  # smallest positive normal number


@element
def constants(settings, h, work):
    return settings[0], settings[1], work


@element
def move(u, v, w, h):
    w = 2 * v - w
    return u + h * w, w


@element
def step(f, at, y, c, n):
    u, v, w, u_next, v_next, w_next, a, perturbed, residual, row_swaps, column_swaps = y
    for j in range(n):
        u_next[j], w_next[j] = move(u[j], v[j], w[j], at.h)
        v_next[j] = v[j]
    scratch = a, perturbed, residual, row_swaps, column_swaps
    if not solve(f, c[2].callback, at.t + at.h, u_next, v_next, w_next, scratch, c, at.h, at.p, n):
        return y, False  # rows u, v and w still hold the last good state
    return (u_next, v_next, w_next, u, v, w, a, perturbed, residual, row_swaps, column_swaps), True


@element
def step_of_one(f, at, y, c, n):
    """The step of one degree of freedom, which divides in place of a factorisation.

    It is a twin: `step` would compile in up to twice the time for it, and its round-off would change the last digits.
    """
    return solve_one(f, c[2].callback, at, y, c)


@element
def solve_one(f, jacobian, at, y, c):
    u, v, w, u_next, v_next, w_next, a, perturbed, unused_0, unused_1, unused_2 = y
    tolerance, limit, work = c
    t, h, p = at.t + at.h, at.h, at.p
    u_next[0], w_next[0] = move(u[0], v[0], w[0], h)
    v_next[0] = v[0]
    iteration, slope, last = 0, 0.0, math.nan
    while True:
        f(t, u_next, v_next, p, a)
        residual = v_next[0] - w_next[0] - h / 2 * a[0]
        scale = abs(v_next[0]) + abs(w_next[0])
        finite = math.isfinite(residual + scale)
        success = iteration > 0 and finite and is_solved(abs(residual), last, scale, abs(u_next[0]), tolerance, h, 1)
        if success or iteration >= limit or not finite:
            break
        last = abs(residual)
        if jacobian is None:
            dv, before = increment(v_next[0], scale), v_next[0]
            v_next[0] += dv
            f(t, u_next, v_next, p, perturbed)
            v_next[0] = before
            slope = (perturbed[0] - a[0]) / dv
        else:
            jacobian(t, u_next, v_next, p, work.matrix)
            slope = work.matrix[0, 0]
        v_next[0] -= residual / (1 - h / 2 * slope)
        iteration += 1
    count(work.counters, iteration, 1 if jacobian is None else 0)
    if not success:
        work.counters[RESIDUAL] = last
        return y, False
    v_next[0] -= residual / (1 - h / 2 * slope)
    return (u_next, v_next, w_next, u, v, w, a, perturbed, unused_0, unused_1, unused_2), True


@element
def solve(f, jacobian, t, u, v, w, scratch, c, h, p, n):
    tolerance, limit, work = c
    matrix = work.matrix
    a, perturbed, residual, row_swaps, column_swaps = scratch
    iteration, last = 0, math.nan
    while True:
        f(t, u, v, p, a)
        norm = scale = size = 0.0
        for j in range(n):
            residual[j] = v[j] - w[j] - h / 2 * a[j]
            norm += abs(residual[j])  # a sum, because a maximum may ignore a NaN
            scale += abs(v[j]) + abs(w[j])
            size += abs(u[j])
        finite = math.isfinite(norm + scale + size)
        if iteration > 0 and finite and is_solved(norm, last, scale, size, tolerance, h, n):
            correct(v, n, residual, matrix, row_swaps, column_swaps)
            count(work.counters, iteration, n if jacobian is None else 0)
            return True
        if iteration >= limit or not finite:
            break
        last = norm
        if jacobian is None:
            differences(f, t, u, v, a, perturbed, scale / n, n, matrix, p)
        else:
            matrix[:] = 0.0
            jacobian(t, u, v, p, matrix)
        for i in range(n):
            for j in range(n):
                matrix[i, j] *= -h / 2
            matrix[i, i] += 1
        iteration += 1
        if not ldu.factorise(matrix, n, row_swaps, column_swaps):
            break
        correct(v, n, residual, matrix, row_swaps, column_swaps)
    count(work.counters, iteration, n if jacobian is None else 0)
    work.counters[RESIDUAL], work.counters[DEGREE] = last, first_not_finite(residual, n)
    return False


@element
def count(counters, iterations, evaluations_each):
    counters[EVALUATIONS] += 1 + iterations * (1 + evaluations_each)
    counters[ITERATIONS] += iterations


@element
def is_solved(residual, last, speed, size, tolerance, h, n):
    # The first test compares the residual with the velocity. The second is for a system at rest under load: v is then
    # only the round-off of f, which iterating does not reduce, and which changes u by less than the round-off of u. The
    # third is for denormal v or h f.
    if residual <= tolerance * speed:
        return True
    return residual > last / 2 and (h * residual <= ROUND_OFF * size or residual <= n * (1 + h) * DENORMAL_ROUND_OFF)


@element
def first_not_finite(values, n):
    for j in range(n):
        if not math.isfinite(values[j]):
            return j
    return 0


@element
def correct(v, n, residual, matrix, row_swaps, column_swaps):
    ldu.solve(matrix, n, row_swaps, column_swaps, residual)
    for j in range(n):
        v[j] -= residual[j]


@element
def increment(v, scale):
    size = RELATIVE_INCREMENT * max(abs(v), scale)
    return size if size >= SMALLEST_NORMAL else RELATIVE_INCREMENT


@element
def differences(f, t, u, v, a, perturbed, scale, n, matrix, p):
    for j in range(n):
        kept = v[j]
        v[j] += increment(kept, scale)
        dv = v[j] - kept
        f(t, u, v, p, perturbed)
        v[j] = kept
        for i in range(n):
            matrix[i, j] = (perturbed[i] - a[i]) / dv


def start(u, v, a, h):
    return (v - h / 2 * a,)
