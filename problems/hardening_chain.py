"""Masses in a row joined by hardening springs, struck at one end."""

import numpy as np

from eig3.callbacks import cached_jit
from eig3.problem import Problem


@cached_jit
def rhs(t, u, v, p, a):
    n, k, s = u.size, p[0], p[1]
    force = k * u[0] * (1 + s * u[0] * u[0])  # of the spring before mass j; the wall is before mass 0
    for j in range(n - 1):
        stretch = u[j + 1] - u[j]
        after = k * stretch * (1 + s * stretch * stretch)
        a[j] = after - force
        force = after
    a[n - 1] = -force


@cached_jit
def energy(t, u, v, p):
    """Of the unit of mass that one lump has."""
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
    """A chain of unit masses from a wall to a free end, which is struck towards the wall.

    Parameters
    ----------
    n : int
        Masses; two at least.
    stiffness : float
        Of a spring at rest, by mass, 1/s^2.
    hardening : float
        A spring stretched by d pulls with stiffness d (1 + hardening d^2); 1/m^2.
    speed : float
        That of the free mass at the start, m/s.
    t_end : float
        Duration, s: some five passes of the wave with the defaults.

    Raises
    ------
    ValueError
        For fewer than two masses.
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
        uses_velocity=False,
        source="Fermi, Pasta, Ulam and Tsingou's chain with cubic forces, struck as a rod in impact tests",
    )
