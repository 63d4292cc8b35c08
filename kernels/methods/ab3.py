"""AB3, the third-order Adams-Bashforth method on (u, v). RK3, which has the same order, takes the first two steps.

u_{n+1} = u_n + h/12 (23 v_n - 16 v_{n-1} + 5 v_{n-2})
v_{n+1} = v_n + h/12 (23 a_n - 16 a_{n-1} + 5 a_{n-2})
"""

from ..compile.jit import element

PAST, ROWS, EVALUATIONS = 4, 7, 1
START, START_STEPS = "rk3", 2


@element
def update(u, v, a, v1, a1, v2, a2, h):
    c = h / 12
    return u + c * (23 * v - 16 * v1 + 5 * v2), v + c * (5 * a2 - 16 * a1) + c * 23 * a


@element
def step(f, at, y, c, n):
    u, v, v1, a1, v2, a2, a = y
    f(at.t, u, v, at.p, a)
    for j in range(n):
        v_now = v[j]
        u[j], v[j] = update(u[j], v_now, a[j], v1[j], a1[j], v2[j], a2[j], at.h)
        v2[j] = v_now
    return (u, v, v2, a, v1, a1, a2), True
