"""CD, the central difference method, for a force that depends on velocity: v_n by fixed-point iteration.

The step is that of `cd_newton`, and v = w + h/2 f(t, u, v) is repeated until v stands still, starting from the last
step's acceleration. It converges where h/2 |df/dv| < 1 and needs no Jacobian: the cheaper choice where that is small.
"""

import math

from .cd_newton import first_not_finite, is_solved, move
from .jit import element
from .march import march_scalar, march_vector


@element
def step_scalar(f, t, y, c, h, p):
    u, v, w = y
    tolerance, limit, tally = c
    impulse = v - w
    u, w = move(u, v, w, h)
    v = w + impulse
    tally[2] = math.nan
    for _ in range(limit):
        v_next = w + h / 2 * f(t + h, u, v, p)
        change = abs(v_next - v)
        v = v_next
        tally[0] += 1
        tally[1] += 1
        scale = abs(v) + abs(w)
        if not math.isfinite(change + scale):
            break
        if is_solved(change, tally[2], scale, abs(u), tolerance, h, 1):
            return (u, v, w), True
        tally[2] = change
    return (u, v, w), False


@element
def step_vector(f, t, y, c, h, p, n):
    u, v, w, u_kept, v_kept, w_kept, a = y
    tolerance, limit, tally = c
    for j in range(n):
        u_kept[j], v_kept[j], w_kept[j] = u[j], v[j], w[j]
        impulse = v[j] - w[j]
        u[j], w[j] = move(u[j], v[j], w[j], h)
        v[j] = w[j] + impulse
    tally[2] = math.nan
    for _ in range(limit):
        f(t + h, u, v, p, a)
        tally[0] += 1
        tally[1] += 1
        change = scale = size = 0.0
        for j in range(n):
            v_next = w[j] + h / 2 * a[j]
            change += abs(v_next - v[j])  # a sum, since a maximum may pass over a NaN
            scale += abs(v_next) + abs(w[j])
            size += abs(u[j])
            v[j] = v_next
        if not math.isfinite(change + scale + size):
            break
        if is_solved(change, tally[2], scale, size, tolerance, h, n):
            return True
        tally[2] = change
    tally[3] = first_not_finite(v)
    for j in range(n):  # the state stays what the last good step left
        u[j], v[j], w[j] = u_kept[j], v_kept[j], w_kept[j]
    return False


def scratch(n):
    return 4


def start(u, v, a, h):
    return (v - h / 2 * a,)


def scalar(f, state, settings, tally, run):
    y = state[0], state[1], state[2]
    y, taken = march_scalar(step_scalar, f, y, (settings[0], int(settings[1]), tally), run)
    state[0], state[1], state[2] = y
    return taken


def vector(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3], state[4], state[5], state[6]
    return march_vector(step_vector, f, y, (settings[0], int(settings[1]), tally), run)
