"""CD, the central difference method, for a force that depends on velocity: v_n by Newton's method.

    w_{n+1} = 2 v_n - w_n        u_{n+1} = u_n + h w_{n+1}        solve  v = w + h/2 f(t, u, v)  for v_{n+1}

with w_n = (u_n - u_{n-1}) / h, so that u_{n+1} = u_{n-1} + 2 h v_n. Newton starts from the last step's v and factorises
I - h/2 df/dv by LDU with rook pivoting, as the article does. df/dv is the caller's `jacobian`, or differences of f. The
residual that passes the tolerance is put to use: the last factors correct v once more, at no evaluation. Without it the
errors below the tolerance, all of one sign, add up over 1e7 steps.
"""

import math

from . import ldu
from .jit import element
from .march import march_scalar, march_vector

ROUND_OFF = 2.0**-50  # four units in the last place
DENORMAL_ROUND_OFF = 2.0**-1072  # the same below the normal numbers, where it does not shrink with the number
RELATIVE_INCREMENT = 2.0**-26  # the square root of the machine epsilon: balances truncation against round-off
SMALLEST_NORMAL = 2.0**-1022


@element
def move(u, v, w, h):
    w = 2 * v - w
    return u + h * w, w


@element
def increment(v, scale):
    size = RELATIVE_INCREMENT * max(abs(v), scale)
    return size if size >= SMALLEST_NORMAL else RELATIVE_INCREMENT


@element
def count(tally, iterations, evaluations_each):
    tally[0] += 1 + iterations * (1 + evaluations_each)
    tally[1] += iterations


@element
def solve_scalar(f, jacobian, t, u, v, w, tolerance, limit, tally, h, p):
    differenced = 1 if jacobian is None else 0
    iteration = 0
    slope = 0.0
    tally[2] = math.nan
    while True:
        a = f(t, u, v, p)
        residual = v - w - h / 2 * a
        scale = abs(v) + abs(w)
        finite = math.isfinite(residual + scale)
        if iteration > 0 and finite and is_solved(abs(residual), tally[2], scale, abs(u), tolerance, h, 1):
            count(tally, iteration, differenced)
            return v - residual / (1 - h / 2 * slope), True
        if iteration >= limit or not finite:
            count(tally, iteration, differenced)
            return v, False
        tally[2] = abs(residual)
        if jacobian is None:
            dv = increment(v, scale)
            slope = (f(t, u, v + dv, p) - a) / dv
        else:
            slope = jacobian(t, u, v, p)
        v -= residual / (1 - h / 2 * slope)
        iteration += 1


@element
def solve_vector(f, jacobian, t, u, v, w, a, perturbed, residual, c, h, p, n):
    tolerance, limit, tally, matrix, row_swaps, column_swaps = c[1:]
    differenced = n if jacobian is None else 0
    iteration = 0
    tally[2] = math.nan
    while True:
        f(t, u, v, p, a)
        norm = scale = size = 0.0
        for j in range(n):
            residual[j] = v[j] - w[j] - h / 2 * a[j]
            norm += abs(residual[j])  # a sum, since a maximum may pass over a NaN
            scale += abs(v[j]) + abs(w[j])
            size += abs(u[j])
        finite = math.isfinite(norm + scale + size)
        if iteration > 0 and finite and is_solved(norm, tally[2], scale, size, tolerance, h, n):
            correct(v, n, residual, matrix, row_swaps, column_swaps)
            count(tally, iteration, differenced)
            return True
        if iteration >= limit or not finite:
            break
        tally[2] = norm
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
    count(tally, iteration, differenced)
    tally[3] = first_not_finite(residual)
    return False


@element
def is_solved(residual, last, speed, size, tolerance, h, n):
    # The second test is for a system at rest under load, where all that is left of v is the round-off of f: iterating
    # does not lessen it, and it moves u by less than the round-off of u. The third is for v or h f that are denormal.
    if residual <= tolerance * speed:
        return True
    return residual > last / 2 and (h * residual <= ROUND_OFF * size or residual <= n * (1 + h) * DENORMAL_ROUND_OFF)


@element
def first_not_finite(values):
    for j in range(values.size):
        if not math.isfinite(values[j]):
            return j
    return 0


@element
def correct(v, n, residual, matrix, row_swaps, column_swaps):
    ldu.solve(matrix, n, row_swaps, column_swaps, residual)
    for j in range(n):
        v[j] -= residual[j]


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


@element
def step_scalar(f, t, y, c, h, p):
    u, v, w = y
    jacobian, tolerance, limit, tally = c
    u, w = move(u, v, w, h)
    v, success = solve_scalar(f, jacobian, t + h, u, v, w, tolerance, limit, tally, h, p)
    return (u, v, w), success


@element
def step_vector(f, t, y, c, h, p, n):
    u, v, w, u_kept, v_kept, w_kept, a, perturbed, residual = y
    for j in range(n):
        u_kept[j], v_kept[j], w_kept[j] = u[j], v[j], w[j]
        u[j], w[j] = move(u[j], v[j], w[j], h)
    if solve_vector(f, c[0], t + h, u, v, w, a, perturbed, residual, c, h, p, n):
        return True
    for j in range(n):  # the state stays what the last good step left
        u[j], v[j], w[j] = u_kept[j], v_kept[j], w_kept[j]
    return False


def scratch(n):
    return 8 + n  # three copies, three vectors, two permutations and the matrix


def start(u, v, a, h):
    return (v - h / 2 * a,)


@element
def run_scalar(f, jacobian, state, settings, tally, run):
    y = state[0], state[1], state[2]
    y, taken = march_scalar(step_scalar, f, y, (jacobian, settings[0], settings[1], tally), run)
    state[0], state[1], state[2] = y
    return taken


@element
def run_vector(f, jacobian, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3], state[4], state[5], state[6], state[7], state[8]
    c = (jacobian, settings[0], settings[1], tally, state[11:], state[9], state[10])
    return march_vector(step_vector, f, y, c, run)


def scalar(f, state, settings, tally, run):
    return run_scalar(f, None, state, settings, tally, run)


def scalar_jacobian(f, jacobian, state, settings, tally, run):
    return run_scalar(f, jacobian, state, settings, tally, run)


def vector(f, state, settings, tally, run):
    return run_vector(f, None, state, settings, tally, run)


def vector_jacobian(f, jacobian, state, settings, tally, run):
    return run_vector(f, jacobian, state, settings, tally, run)
