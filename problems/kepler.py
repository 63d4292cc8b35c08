"""A planet around a fixed sun: on an eccentric orbit, the short passage near the sun needs the smallest steps."""

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from eig3 import drawing
from eig3.animation import Mechanism, in_plane
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p, a):
    square = u[0] * u[0] + u[1] * u[1]
    pull = p[0] / (square * math.sqrt(square))
    a[0] = -pull * u[0]
    a[1] = -pull * u[1]


@jit
def energy(t, u, v, p):
    return (v[0] * v[0] + v[1] * v[1]) / 2 - p[0] / math.sqrt(u[0] * u[0] + u[1] * u[1])


@jit
def angular_momentum(t, u, v, p):
    """Per unit mass, m^2/s; constant along the exact solution, as the energy is."""
    return u[0] * v[1] - u[1] * v[0]


def kepler(GM: float = 1.0, a: float = 1.0, e: float = 0.9, t_end: float | None = None) -> Problem:
    """Kepler's problem in the plane, from the perihelion; u is (x, y) in m, and the sun is at the origin.

    Parameters
    ----------
    GM : float
        Gravitational parameter, m^3/s^2.
    a : float
        Semi-major axis, m.
    e : float
        Eccentricity, at least 0 and below 1.
    t_end : float, optional
        Duration, s; twenty orbits of 2 pi sqrt(a^3 / GM) if not given.

    Raises
    ------
    ValueError
        If GM or a is not positive, or if e is not in [0, 1).

    Notes
    -----
    `exact` solves Kepler's equation to round-off. The angular momentum is another invariant; import it with
    ``from eig3.problems.kepler import angular_momentum``: in `eig3.problems`, `kepler` is the function.
    """
    for name, value in (("GM", GM), ("a", a)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}.")
    if not 0 <= e < 1:
        raise ValueError(f"e must be at least 0 and below 1, as on an orbit that returns, not {e}.")
    exact = partial(ellipse, GM=GM, a=a, e=e)
    period = 2 * math.pi * math.sqrt(a**3 / GM)
    return Problem(
        name="kepler",
        rhs=rhs,
        u0=(a * (1 - e), 0.0),
        v0=(0.0, math.sqrt(GM / a * (1 + e) / (1 - e))),
        params=(GM,),
        t_span=(0.0, 20 * period if t_end is None else t_end),
        energy=energy,
        energy_unit="J/kg",
        exact=exact,
        source="Kepler, Astronomia nova, chapter 60; as a test, Hairer, Lubich and Wanner, Geometric Numerical "
        "Integration, section I.2",
        h=1e-3,
        draw=partial(draw, exact=exact, period=period),
        view=Mechanism(in_plane, trails=[0], marks=[((0, 0), "C1o", 12, "sun")]),
    )


def ellipse(t: ArrayLike, GM: float, a: float, e: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the place and the velocity at the times t of the motion that starts at the perihelion."""
    t = np.asarray(t, dtype=np.float64)
    rate, b = math.sqrt(GM / a) / a, a * math.sqrt((1 - e) * (1 + e))
    # sin and cos reduce the angle by the exact 2 pi; a remainder by the rounded 2 pi adds an error every orbit
    E = eccentric_anomaly(np.arctan2(np.sin(rate * t), np.cos(rate * t)), e)
    sine, cosine = np.sin(E), np.cos(E)
    E_rate = rate / (1 - e * cosine)
    u = np.stack([a * (cosine - e), b * sine], axis=-1)
    return u, np.stack([-a * E_rate * sine, b * E_rate * cosine], axis=-1)


def eccentric_anomaly(M: np.ndarray, e: float) -> np.ndarray:
    """Solve Kepler's equation E - e sin E = M for E, with the mean anomaly M from -pi to pi.

    For M >= 0 the left side is convex. Newton's method that starts above the solution therefore decreases to it without
    passing it, and has converged when E no longer decreases.
    """
    sign, M = np.sign(M), np.abs(M)
    E = np.minimum(np.minimum(M + e, M / (1 - e)), np.pi)
    while True:
        lower = np.minimum(E, E - (E - e * np.sin(E) - M) / (1 - e * np.cos(E)))
        if not (lower < E).any():
            return sign * E
        E = lower


def draw(figure, solution, exact, period):
    orbit = drawing.picture(figure, aspect="equal")
    drawing.path(orbit, *solution.u.T, "C0", "planet's path")
    orbit.plot(*exact(np.linspace(0, period, 1000))[0].T, "k--", linewidth=1, label="exact orbit")
    orbit.plot(0, 0, "C1o", markersize=9, label="sun (focus)")
    orbit.set(xlabel="x (m)", ylabel="y (m)")
    drawing.legend(orbit)
    drawing.histories(figure, solution, ["x", "y"])
