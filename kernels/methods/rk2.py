"""RK2, Heun's method (the explicit trapezoidal rule), with the stage velocities eliminated.

    a_1 = f(t, u, v)                        u_{n+1} = u + h v + h^2/2 a_1
    a_2 = f(t + h, u + h v, v + h a_1)      v_{n+1} = v + h/2 (a_1 + a_2)

The article's tables come from this method, not from the midpoint rule, the other well-known method of two stages.
"""

from ..compile.jit import element

ROWS, EVALUATIONS = 6, 2


@element
def step(f, at, y, c, n):
    t, h, p = at.t, at.h, at.p
    u, v, u2, v2, a1, a2 = y
    f(t, u, v, p, a1)
    for j in range(n):
        u2[j], v2[j] = u[j] + h * v[j], v[j] + h * a1[j]
    f(t + h, u2, v2, p, a2)
    for j in range(n):
        u[j], v[j] = u[j] + h * v[j] + h * h / 2 * a1[j], v[j] + h / 2 * a1[j] + h / 2 * a2[j]
    return y, True
