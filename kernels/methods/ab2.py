"""AB2, the second-order Adams-Bashforth method on (u, v).

    u_{n+1} = u_n + h (3/2 v_n - 1/2 v_{n-1})
    v_{n+1} = v_n + h (3/2 a_n - 1/2 a_{n-1})

The past values at the start are v_{-1} = v_0 - h a_0 and a_{-1} = a_0. They make the first step a Taylor step,
u_1 = u_0 + h v_0 + h^2/2 a_0 and v_1 = v_0 + h a_0.
"""

from ..compile.jit import element

PAST, ROWS, EVALUATIONS = 2, 5, 1


@element
def step(f, at, y, c, n):
    u, v, v_past, a_past, a = y
    h = at.h
    f(at.t, u, v, at.p, a)
    for j in range(n):
        v_now = v[j]
        u[j], v[j] = (
            u[j] + h * (1.5 * v_now - 0.5 * v_past[j]),
            v_now - h / 2 * a_past[j] + 1.5 * h * a[j],
        )
        v_past[j] = v_now
    return (u, v, v_past, a, a_past), True


def start(u, v, a, h):
    return v - h * a, a
