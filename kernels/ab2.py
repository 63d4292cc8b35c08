"""AB2, the second-order Adams-Bashforth method on (u, v).

    u_{n+1} = u_n + h (3/2 v_n - 1/2 v_{n-1})
    v_{n+1} = v_n + h (3/2 a_n - 1/2 a_{n-1})

A past of v_{-1} = v_0 - h a_0 and a_{-1} = a_0 makes the first step the Taylor step
u_1 = u_0 + h v_0 + h^2/2 a_0, v_1 = v_0 + h a_0.
"""

from .jit import element
from .march import march_scalar, march_vector


@element
def update(u, v, a, v_past, a_past, h):
    return u + h * (1.5 * v - 0.5 * v_past), v - h / 2 * a_past + 1.5 * h * a


@element
def step_scalar(f, t, y, c, h, p):
    u, v, v_past, a_past = y
    a = f(t, u, v, p)
    u_next, v_next = update(u, v, a, v_past, a_past, h)
    return (u_next, v_next, v, a), True


@element
def step_vector(f, t, y, c, h, p, n):
    u, v, v_past, a_past, a = y
    f(t, u, v, p, a)
    for j in range(n):
        v_now = v[j]
        u[j], v[j] = update(u[j], v_now, a[j], v_past[j], a_past[j], h)
        v_past[j], a_past[j] = v_now, a[j]
    return True


def scratch(n):
    return 1


def start(u, v, a, h):
    return v - h * a, a


def scalar(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3]
    y, taken = march_scalar(step_scalar, f, y, (), run)
    state[0], state[1], state[2], state[3] = y
    tally[0] += taken
    return taken


def vector(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3], state[4]
    taken = march_vector(step_vector, f, y, (), run)
    tally[0] += taken
    return taken
