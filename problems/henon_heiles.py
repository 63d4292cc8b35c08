"""A star in a galaxy, after Henon and Heiles: two degrees of freedom with quadratic forces, regular or chaotic."""

import math

from eig3 import drawing
from eig3.animation import Mechanism, in_plane
from eig3.functions.callbacks import jit
from eig3.problem import Problem

ESCAPE = 1 / 6  # energy of the saddles of the potential


@jit
def rhs(t, u, v, p, a):
    x, y = u[0], u[1]
    a[0] = -x - 2 * x * y
    a[1] = -y - x * x + y * y


@jit
def energy(t, u, v, p):
    x, y = u[0], u[1]
    return (v[0] * v[0] + v[1] * v[1] + x * x + y * y) / 2 + y * (x * x - y * y / 3)


def henon_heiles(E: float = 1 / 12, y0: float = 0.1, t_end: float = 600.0) -> Problem:
    """The problem of Henon and Heiles, which has no units; u is the place (x, y) in the plane of a galaxy.

    Parameters
    ----------
    E : float
        Energy; the motion stays bounded below 1/6. Almost all motions are regular at 1/12, and most are chaotic at 1/6.
    y0 : float
        y at t = 0; x, and the velocity along y, are zero there, and the velocity along x follows from E.
    t_end : float
        Duration.

    Raises
    ------
    ValueError
        If E is not positive and below 1/6, or y0 is not a place where a motion of this energy can be.
    """
    if not 0 < E < ESCAPE:
        raise ValueError(f"E must be positive and below 1/6, not {E}.")
    square = 2 * E - y0 * y0 + 2 / 3 * y0**3
    if not (square >= 0 and y0 < 1):
        raise ValueError(f"y0 must be closer to 0 for the energy {E}, not {y0}.")
    return Problem(
        name="henon_heiles",
        rhs=rhs,
        u0=(0.0, y0),
        v0=(math.sqrt(square), 0.0),
        params=(),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="-",
        units="-",
        source="Henon and Heiles, The Astronomical Journal 69 (1964), 73-79",
        h=0.01,
        draw=draw,
        view=Mechanism(in_plane, trails=[0], labels=("x (-)", "y (-)")),
    )


def draw(figure, solution):
    drawing.plane(figure, {"path of the star": solution.u.T}, ("x (-)", "y (-)"))
    drawing.histories(figure, solution, ["x", "y"], units=("-", "-"))
