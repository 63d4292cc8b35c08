"""CD, the central difference method in explicit form: for a force without velocity, or with a lagged velocity.

    (u_{n+1} - 2 u_n + u_{n-1}) / h^2 = f(t_n, u_n, w_n)        v_n = (u_{n+1} - u_{n-1}) / (2 h)

The kernel computes the same u and v from the velocity half a step earlier, w_n = (u_n - u_{n-1}) / h:

    w_{n+1} = w_n + h a_n        u_{n+1} = u_n + h w_{n+1}        v_n = w_n + h/2 a_n

The formula 2 u_n - u_{n-1} would lose digits for small h, because a round-off eps in u is a round-off eps/h in the
velocity. f gets w in place of the velocity. This is exact if f does not depend on the velocity. If it does, the method
has only first order. The start u_{-1} = u_0 - h v_0 + h^2/2 a_0 is the same as w_0 = v_0 - h/2 a_0.
"""

from ..compile.jit import element

PAST, ROWS, EVALUATIONS = 2, 4, 1


@element
def move(u, w, a, h):
    # u_{n+1} = u + h w_{n+1}, written so that only one multiply-add has to wait for a.
    return u + h * w + h * h * a, w + h * a


@element
def step(f, at, y, c, n):
    u, _, w, a = y
    for j in range(n):
        u[j], w[j] = move(u[j], w[j], a[j], at.h)
    f(at.t + at.h, u, w, at.p, a)
    return y, True


@element
def complete(y, c, h, n):
    _, v, w, a = y
    for j in range(n):
        v[j] = w[j] + h / 2 * a[j]


def start(u, v, a, h):
    return v - h / 2 * a, a
