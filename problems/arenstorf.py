"""Arenstorf's orbit: a spacecraft in the rotating frame of the earth and the moon, whose orbit has the period 17.07."""

import math

from eig3 import drawing
from eig3.animation import Mechanism, in_plane
from eig3.functions.callbacks import jit
from eig3.problem import Problem

PERIOD = 17.0652165601579625588917206249  # of the orbit from the default start


@jit
def rhs(t, u, v, p, a):
    x, y, mu = u[0], u[1], p[0]
    to_earth, to_moon = x + mu, x - (1 - mu)
    earth = to_earth * to_earth + y * y
    moon = to_moon * to_moon + y * y
    earth_pull = (1 - mu) / (earth * math.sqrt(earth))
    moon_pull = mu / (moon * math.sqrt(moon))
    a[0] = x + 2 * v[1] - earth_pull * to_earth - moon_pull * to_moon
    a[1] = y - 2 * v[0] - (earth_pull + moon_pull) * y


@jit
def energy(t, u, v, p):
    """Jacobi's integral in the rotating frame: the Jacobi constant divided by -2."""
    x, y, mu = u[0], u[1], p[0]
    potential = (1 - mu) / math.hypot(x + mu, y) + mu / math.hypot(x - (1 - mu), y)
    return (v[0] * v[0] + v[1] * v[1] - x * x - y * y) / 2 - potential


def arenstorf(
    mu: float = 0.012277471, x: float = 0.994, vy: float = -2.00158510637908252240537862224, t_end: float = PERIOD
) -> Problem:
    """The restricted three-body problem in the plane, from a start at rest in x on the line through both bodies.

    u is the position (x, y) in the frame that rotates with the bodies. The earth is at x = -mu and the moon at
    x = 1 - mu. All quantities are dimensionless: the bodies are at the distance 1 and rotate at the rate 1 about their
    centre of mass.

    Parameters
    ----------
    mu : float
        Mass of the moon divided by the mass of both bodies; positive, and at most 0.5.
    x : float
        x at t = 0; y is zero there.
    vy : float
        Velocity along y at t = 0; the velocity along x is zero there.
    t_end : float
        Duration. With the defaults it is the period of the orbit.

    Raises
    ------
    ValueError
        If mu is not positive, or is above 0.5.

    Notes
    -----
    The default start is 0.0063 from the moon, and the orbit returns to it after three loops about the earth. The orbit
    is unstable: it multiplies an error at the start by up to some 1e5 within a period.
    """
    if not 0 < mu <= 0.5:
        raise ValueError(f"mu must be positive and at most 0.5, as the part of the lighter body, not {mu}.")
    return Problem(
        name="arenstorf",
        rhs=rhs,
        u0=(x, 0.0),
        v0=(0.0, vy),
        params=(mu,),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="-",
        units="-",
        source="Arenstorf, American Journal of Mathematics 85 (1963), 27-35; as a test, Hairer, Norsett and Wanner, "
        "Solving Ordinary Differential Equations I, section II.0",
        h=1e-4,
        draw=draw,
        view=Mechanism(
            in_plane,
            trails=[0],
            marks=[((-mu, 0), "C2o", 12, "earth"), ((1 - mu, 0), "C7o", 6, "moon")],
            labels=("x (-)", "y (-)"),
        ),
    )


def draw(figure, solution):
    drawing.plane(figure, {"path of the spacecraft": solution.u.T}, ("x (-)", "y (-)"))
    drawing.histories(figure, solution, ["x", "y"], units=("-", "-"))
