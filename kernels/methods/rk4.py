"""RK4, the classical fourth-order Runge-Kutta method, with the stage velocities eliminated.

a_1 = f(t, u, v)
a_2 = f(t + h/2, u + h/2 v, v + h/2 a_1)
a_3 = f(t + h/2, u + h/2 v + h^2/4 a_1, v + h/2 a_2)
a_4 = f(t + h, u + h v + h^2/2 a_2, v + h a_3)
u_{n+1} = u + h v + h^2/6 (a_1 + a_2 + a_3)
v_{n+1} = v + h/6 (a_1 + 2 a_2 + 2 a_3 + a_4)
"""

from ..compile.jit import element

ROWS, EVALUATIONS = 8, 4


@element
def step(f, at, y, c, n):
    t, h, p = at.t, at.h, at.p
    u, v, u_stage, v_stage, a1, a2, a3, a4 = y
    f(t, u, v, p, a1)
    for j in range(n):
        u_stage[j], v_stage[j] = u[j] + h / 2 * v[j], v[j] + h / 2 * a1[j]
    f(t + h / 2, u_stage, v_stage, p, a2)
    for j in range(n):
        u_stage[j], v_stage[j] = u[j] + h / 2 * v[j] + h * h / 4 * a1[j], v[j] + h / 2 * a2[j]
    f(t + h / 2, u_stage, v_stage, p, a3)
    for j in range(n):
        u_stage[j], v_stage[j] = u[j] + h * v[j] + h * h / 2 * a2[j], v[j] + h * a3[j]
    f(t + h, u_stage, v_stage, p, a4)
    for j in range(n):
        u[j], v[j] = (
            u[j] + h * v[j] + h * h / 6 * (a1[j] + a2[j] + a3[j]),
            v[j] + h / 6 * (a1[j] + 2 * a2[j] + 2 * a3[j] + a4[j]),
        )
    return y, True
