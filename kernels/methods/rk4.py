"""RK4, the classical fourth-order Runge-Kutta method, with the stage velocities eliminated.

a_1 = f(t, u, v)
a_2 = f(t + h/2, u + h/2 v, v + h/2 a_1)
a_3 = f(t + h/2, u + h/2 v + h^2/4 a_1, v + h/2 a_2)
a_4 = f(t + h, u + h v + h^2/2 a_2, v + h a_3)
u_{n+1} = u + h v + h^2/6 (a_1 + a_2 + a_3)
v_{n+1} = v + h/6 (a_1 + 2 a_2 + 2 a_3 + a_4)
"""

from ..compile.jit import element
from .rk3 import stage2

ROWS, EVALUATIONS = 8, 4


@element
def stage3(u, v, a1, a2, h):
    return u + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2


@element
def stage4(u, v, a2, a3, h):
    return u + h * v + h * h / 2 * a2, v + h * a3


@element
def update(u, v, a1, a2, a3, a4, h):
    return u + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


@element
def step(f, at, y, c, n):
    t, h, p = at.t, at.h, at.p
    u, v, u_stage, v_stage, a1, a2, a3, a4 = y
    f(t, u, v, p, a1)
    for j in range(n):
        u_stage[j], v_stage[j] = stage2(u[j], v[j], a1[j], h)
    f(t + h / 2, u_stage, v_stage, p, a2)
    for j in range(n):
        u_stage[j], v_stage[j] = stage3(u[j], v[j], a1[j], a2[j], h)
    f(t + h / 2, u_stage, v_stage, p, a3)
    for j in range(n):
        u_stage[j], v_stage[j] = stage4(u[j], v[j], a2[j], a3[j], h)
    f(t + h, u_stage, v_stage, p, a4)
    for j in range(n):
        u[j], v[j] = update(u[j], v[j], a1[j], a2[j], a3[j], a4[j], h)
    return y, True
