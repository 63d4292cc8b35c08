"""EIG-3 with the set (1, 1/2), for a scene with constraints, whose accelerations f do not know them.

    u_{n+1} = u_n + h w_{n+1}        w_{n+1} = w_n + h (f_n + W G_n^T l)        with  phi(t_{n+1}, u_{n+1}) = 0
    v_{n+1} = w_{n+1} + (w_{n+1} - w_n) / 2, projected, so that it keeps the constraints too

`eig3.kernels.constraints.hold` takes the step, with the accelerations and the gradients of the scene. Without
constraints these are the formulas of `eig3`. With constraints, and without a force that depends on the velocity, u is
as in SHAKE, which is symplectic: the energy of a conservative scene stays bounded.
"""

from ..compile.jit import element

PAST, ROWS, EVALUATIONS = 1, 3, 1
KEEPS_CONSTRAINTS = True


@element
def constants(settings, h, work):
    return (work.callback,)


@element
def step(f, at, y, c, n):
    u, v, drift = y
    c[0](at.t, at.h, u, v, drift, at.p)
    return y, True


def start(u, v, a, h):
    return (v - h / 2 * a,)
