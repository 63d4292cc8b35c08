"""CD, the central difference method, made explicit: for a force without velocity, or with a lagged one.

    (u_{n+1} - 2 u_n + u_{n-1}) / h^2 = f(t_n, u_n, w_n)        v_n = (u_{n+1} - u_{n-1}) / (2 h)

run as increments of the velocity w_n = (u_n - u_{n-1}) / h of the half step before,

    w_{n+1} = w_n + h a_n        u_{n+1} = u_n + h w_{n+1}        v_n = w_n + h/2 a_n

because 2 u_n - u_{n-1} loses digits as h shrinks: a rounding eps of u is one of eps/h in the velocity. w stands in for
the velocity in f: nothing is lost where f has none; where it has, the method is of first order only. The start is
u_{-1} = u_0 - h v_0 + h^2/2 a_0, which is w_0 = v_0 - h/2 a_0.
"""

from .jit import element

PAST, ROWS, EVALUATIONS = 2, 4, 1


@element
def move(u, w, a, h):
    # u + h w_{n+1}, written so that one multiply-add follows a
    return u + h * w + h * h * a, w + h * a


@element
def velocity(w, a, h):
    return w + h / 2 * a


@element
def step_scalar(f, at, y, c):
    u, _, w, a = y
    u, w = move(u, w, a, at.h)
    a = f(at.t + at.h, u, w, at.p)
    return (u, velocity(w, a, at.h), w, a), True


@element
def step_vector(f, at, y, c, n):
    u, _, w, a = y
    for j in range(n):
        u[j], w[j] = move(u[j], w[j], a[j], at.h)
    f(at.t + at.h, u, w, at.p, a)
    return y, True


@element
def complete(y, c, h, n):
    _, v, w, a = y
    for j in range(n):
        v[j] = velocity(w[j], a[j], h)


def start(u, v, a, h):
    return v - h / 2 * a, a
