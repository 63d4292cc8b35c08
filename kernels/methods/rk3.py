"""RK3, Kutta's third-order method (c = 0, 1/2, 1; b = 1/6, 2/3, 1/6), with the stage velocities eliminated.

a_1 = f(t, u, v)
a_2 = f(t + h/2, u + h/2 v, v + h/2 a_1)
a_3 = f(t + h, u + h v + h^2 a_1, v + h (2 a_2 - a_1))
u_{n+1} = u + h v + h^2/6 (a_1 + 2 a_2)
v_{n+1} = v + h/6 (a_1 + 4 a_2 + a_3)
"""

from ..compile.jit import element

ROWS, EVALUATIONS = 7, 3


@element
def step(f, at, y, c, n):
    t, h, p = at.t, at.h, at.p
    u, v, u_stage, v_stage, a1, a2, a3 = y
    f(t, u, v, p, a1)
    for j in range(n):
        u_stage[j], v_stage[j] = u[j] + h / 2 * v[j], v[j] + h / 2 * a1[j]
    f(t + h / 2, u_stage, v_stage, p, a2)
    for j in range(n):
        u_stage[j], v_stage[j] = u[j] + h * v[j] + h * h * a1[j], v[j] - h * a1[j] + 2 * h * a2[j]
    f(t + h, u_stage, v_stage, p, a3)
    for j in range(n):
        u[j], v[j] = (
            u[j] + h * v[j] + h * h / 6 * (a1[j] + 2 * a2[j]),
            v[j] + h / 6 * (a1[j] + 4 * a2[j]) + h / 6 * a3[j],
        )
    return y, True
