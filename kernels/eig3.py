"""EIG-3(alpha, beta), the explicit integration method of grade 3.

    a_n     = f(t_n, u_n, v_n)
    u_{n+1} = u_n + h v_n + h^2/2 [a_n + alpha (a_n - a_{n-1})]
    v_{n+1} = v_n + h [a_n + beta (a_n - a_{n-1})]

The first step has no a_{-1}; taking a_{-1} = a_0 makes it the Taylor step of the article.
"""

from .jit import element
from .march import march_scalar, march_vector


@element
def update(u, v, a, a_past, c, h):
    # Grouped so that one multiply-add follows a: nothing else of the next u waits for the right-hand side.
    c_now, c_past, b_now, b_past = c
    return u + (h * v - c_past * a_past) + c_now * a, v - b_past * a_past + b_now * a


@element
def step_scalar(f, t, y, c, h, p):
    u, v, a_past = y
    a = f(t, u, v, p)
    u, v = update(u, v, a, a_past, c, h)
    return (u, v, a), True


@element
def step_vector(f, t, y, c, h, p, n):
    u, v, a_past, a = y
    f(t, u, v, p, a)
    for j in range(n):
        u[j], v[j] = update(u[j], v[j], a[j], a_past[j], c, h)
        a_past[j] = a[j]
    return True


@element
def coefficients(settings, h):
    alpha, beta = settings[0], settings[1]
    return h * h / 2 * (1 + alpha), h * h / 2 * alpha, h * (1 + beta), h * beta


def scratch(n):
    return 1


def start(u, v, a, h):
    return (a,)


def scalar(f, state, settings, tally, run):
    y = state[0], state[1], state[2]
    y, taken = march_scalar(step_scalar, f, y, coefficients(settings, run[0]), run)
    state[0], state[1], state[2] = y
    tally[0] += taken
    return taken


def vector(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3]
    taken = march_vector(step_vector, f, y, coefficients(settings, run[0]), run)
    tally[0] += taken
    return taken
