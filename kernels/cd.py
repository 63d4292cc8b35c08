"""CD, the central difference method, made explicit: for a force without velocity, or with a lagged one.

    (u_{n+1} - 2 u_n + u_{n-1}) / h^2 = f(t_n, u_n, w_n)        v_n = (u_{n+1} - u_{n-1}) / (2 h)

run as increments of the velocity w_n = (u_n - u_{n-1}) / h of the half step before,

    w_{n+1} = w_n + h a_n        u_{n+1} = u_n + h w_{n+1}        v_n = w_n + h/2 a_n

because 2 u_n - u_{n-1} loses digits as h shrinks: a rounding eps of u is one of eps/h in the velocity. w stands in for
the velocity in f: nothing is lost where f has none; where it has, the method is of first order only. The start is
u_{-1} = u_0 - h v_0 + h^2/2 a_0, which is w_0 = v_0 - h/2 a_0.
"""

from .jit import element
from .march import march_scalar, march_vector_lazily


@element
def move(u, w, a, h):
    # u + h w_{n+1}, written so that one multiply-add follows a
    return u + h * w + h * h * a, w + h * a


@element
def velocity(w, a, h):
    return w + h / 2 * a


@element
def step_scalar(f, t, y, c, h, p):
    u, _, w, a = y
    u, w = move(u, w, a, h)
    a = f(t + h, u, w, p)
    return (u, velocity(w, a, h), w, a), True


@element
def step_vector(f, t, y, c, h, p, n):
    u, _, w, a = y
    for j in range(n):
        u[j], w[j] = move(u[j], w[j], a[j], h)
    f(t + h, u, w, p, a)
    return True


@element
def complete(y, c, h, n):
    _, v, w, a = y
    for j in range(n):
        v[j] = velocity(w[j], a[j], h)


def scratch(n):
    return 0


def start(u, v, a, h):
    return v - h / 2 * a, a


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
