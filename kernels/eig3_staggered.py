"""EIG-3(1, 1/2) for a force without velocity, carried by the velocity of the half step.

    w_n = v_n - h/2 a_{n-1}
    w_{n+1} = w_n + h a_n        u_{n+1} = u_n + h w_{n+1}        v_{n+1} = w_{n+1} + h/2 a_n

are the formulas of EIG-3 with other names, and the positions those of central difference. Where f does not read v, no
step needs it: with n degrees of freedom fewer arrays are read and written in a step.
"""

from .cd import complete, move, scratch, start, velocity
from .jit import element
from .march import march_scalar, march_vector_lazily

__all__ = ["scalar", "scratch", "start", "vector"]


@element
def step_scalar(f, t, y, c, h, p):
    u, v, w, a = y
    a = f(t, u, v, p)
    u, w = move(u, w, a, h)
    return (u, velocity(w, a, h), w, a), True


@element
def step_vector(f, t, y, c, h, p, n):
    u, v, w, a = y
    f(t, u, v, p, a)
    for j in range(n):
        u[j], w[j] = move(u[j], w[j], a[j], h)
    return True


def scalar(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3]
    y, taken = march_scalar(step_scalar, f, y, (), run)
    state[0], state[1], state[2], state[3] = y
    tally[0] += taken
    return taken


def vector(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3]
    taken = march_vector_lazily(step_vector, complete, f, y, (), run)
    tally[0] += taken
    return taken
