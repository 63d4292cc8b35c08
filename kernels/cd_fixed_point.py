"""CD, the central difference method, for a force that depends on velocity: v_n by fixed-point iteration.

The step is that of `cd_newton`, and v = w + h/2 f(t, u, v) is repeated until v stands still, starting from the last
step's acceleration. It converges where h/2 |df/dv| < 1 and needs no Jacobian: the cheaper choice where that is small.
"""

import math

from .cd_newton import move
from .jit import element
from .march import march_scalar, march_vector

SCRATCH = 4


@element
def step_scalar(f, t, y, c, h, p):
    u, v, w = y
    tolerance, limit, tally = c
    impulse = v - w
    u, w = move(u, v, w, h)
    v = w + impulse
    for _ in range(limit):
        v_next = w + h / 2 * f(t + h, u, v, p)
        change = abs(v_next - v)
        v = v_next
        tally[0] += 1
        tally[1] += 1
        tally[2] = change
        if change <= tolerance * (abs(v) + abs(w)):
            return (u, v, w), True
        if not math.isfinite(change):
            break
    return (u, v, w), False


@element
def step_vector(f, t, y, c, h, p):
    u, v, w, u_next, v_next, w_next, a = y
    tolerance, limit, tally = c
    for j in range(u.size):
        u_next[j], w_next[j] = move(u[j], v[j], w[j], h)
        v_next[j] = w_next[j] + (v[j] - w[j])
    for _ in range(limit):
        f(t + h, u_next, v_next, p, a)
        tally[0] += 1
        tally[1] += 1
        change = scale = 0.0
        for j in range(u.size):
            v_new = w_next[j] + h / 2 * a[j]
            change += abs(v_new - v_next[j])  # a sum, since a maximum may pass over a NaN
            scale += abs(v_new) + abs(w_next[j])
            v_next[j] = v_new
        tally[2] = change
        if change <= tolerance * scale:
            for j in range(u.size):
                u[j], v[j], w[j] = u_next[j], v_next[j], w_next[j]
            return True
        if not math.isfinite(change):
            break
    return False


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
