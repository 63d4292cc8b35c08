"""A row of masses joined by hardening springs, with an impact at one end."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.animation import Profile
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p, a):
    n, k, s = u.size, p[0], p[1]
    force = k * u[0] * (1 + s * u[0] * u[0])  # in the spring before mass j; the wall is before mass 0
    for j in range(n - 1):
        stretch = u[j + 1] - u[j]
        after = k * stretch * (1 + s * stretch * stretch)
        a[j] = after - force
        force = after
    a[n - 1] = -force


@jit
def energy(t, u, v, p):
    """Energy per mass of one lump, J/kg."""
    k, s = p[0], p[1]
    total, before = 0.0, 0.0
    for j in range(u.size):
        square = (u[j] - before) * (u[j] - before)
        total += v[j] * v[j] / 2 + k * square / 2 + k * s * square * square / 4
        before = u[j]
    return total


def hardening_chain(
    n: int = 200, stiffness: float = 1e4, hardening: float = 1e4, speed: float = 1.0, t_end: float = 10.0
) -> Problem:
    """A chain of equal masses from a wall to a free end, with an impact on the free end; u is the displacements in m.

    Parameters
    ----------
    n : int
        Number of masses, at least 2.
    stiffness : float
        Stiffness of an unstretched spring per mass, 1/s^2.
    hardening : float
        Coefficient of the cubic term, 1/m^2. The force per mass of a spring stretched by d is
        stiffness d (1 + hardening d^2).
    speed : float
        Speed of the free mass towards the wall at t = 0, m/s.
    t_end : float
        Duration, s. With the defaults, the wave travels along the chain about five times.

    Raises
    ------
    ValueError
        If n is less than 2.
    """
    if n < 2:
        raise ValueError(f"n must be at least 2, not {n}.")
    v0 = np.zeros(n)
    v0[-1] = -speed
    return Problem(
        name="hardening_chain",
        rhs=rhs,
        u0=np.zeros(n),
        v0=v0,
        params=(stiffness, hardening),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="J/kg",
        source="Fermi, Pasta, Ulam and Tsingou's chain with cubic forces, with an impact as in tests of rods",
        draw=partial(drawing.field, places=np.arange(1.0, n + 1), label="number of the mass", units=("m", "m/s")),
        view=Profile(np.arange(1.0, n + 1), "number of the mass"),
    )
