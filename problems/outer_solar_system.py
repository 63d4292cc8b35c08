"""The sun and the five outer planets, which attract each other, over ten thousand years."""

import math

import numpy as np

from eig3 import drawing
from eig3.animation import Mechanism
from eig3.functions.callbacks import jit
from eig3.problem import Problem

AU = 149_597_870_700.0  # m
DAY = 86_400.0  # s
YEAR = 365.25 * DAY
GM_SUN = 2.95912208286e-4 * AU**3 / DAY**2  # m^3/s^2

#: Masses as parts of the sun's, places in au and velocities in au/day; the mass of the inner planets is in the sun.
BODIES = {
    "sun": (1.00000597682, (0, 0, 0), (0, 0, 0)),
    "Jupiter": (0.000954786104043, (-3.5023653, -3.8169847, -1.5507963), (0.00565429, -0.00412490, -0.00190589)),
    "Saturn": (0.000285583733151, (9.0755314, -3.0458353, -1.6483708), (0.00168318, 0.00483525, 0.00192462)),
    "Uranus": (0.0000437273164546, (8.3101420, -16.2901086, -7.2521278), (0.00354178, 0.00137102, 0.00055029)),
    "Neptune": (0.0000517759138449, (11.4707666, -25.7294829, -10.8169456), (0.00288930, 0.00114527, 0.00039677)),
    "Pluto": (1 / 1.3e8, (-15.5387357, -25.2225594, -3.1902382), (0.00276725, -0.00170702, -0.00136504)),
}


@jit
def rhs(t, u, v, p, a):
    for i in range(p.size):
        x, y, z = u[3 * i], u[3 * i + 1], u[3 * i + 2]
        ax, ay, az = 0.0, 0.0, 0.0
        for k in range(i):
            dx, dy, dz = u[3 * k] - x, u[3 * k + 1] - y, u[3 * k + 2] - z
            square = dx * dx + dy * dy + dz * dz
            pull = 1 / (square * math.sqrt(square))
            ax += p[k] * pull * dx
            ay += p[k] * pull * dy
            az += p[k] * pull * dz
            a[3 * k] -= p[i] * pull * dx
            a[3 * k + 1] -= p[i] * pull * dy
            a[3 * k + 2] -= p[i] * pull * dz
        a[3 * i], a[3 * i + 1], a[3 * i + 2] = ax, ay, az


@jit
def energy(t, u, v, p):
    """Kinetic and potential energy, for each kilogram of the sun."""
    total = 0.0
    for i in range(p.size):
        for j in range(3):
            total += p[i] * v[3 * i + j] * v[3 * i + j] / 2
        for k in range(i):
            dx, dy, dz = u[3 * k] - u[3 * i], u[3 * k + 1] - u[3 * i + 1], u[3 * k + 2] - u[3 * i + 2]
            total -= p[i] * p[k] / math.sqrt(dx * dx + dy * dy + dz * dz)
    return total / p[0]


def outer_solar_system(t_end: float = 1e4 * YEAR) -> Problem:
    """The sun, Jupiter, Saturn, Uranus, Neptune and Pluto; u has x, y and z of each of them, m.

    Parameters
    ----------
    t_end : float
        Duration, s; 10,000 years if not given.

    Notes
    -----
    The parameters are G m of the six bodies, m^3/s^2. The motion starts on 5 September 1994, with the centre of mass
    at rest at the origin. Jupiter turns about the sun once in 11.9 years, and Pluto once in 248 years.
    """
    masses, places, velocities = (np.array(x, dtype=np.float64) for x in zip(*BODIES.values(), strict=True))
    places, velocities = (x - masses @ x / masses.sum() for x in (places, velocities))
    return Problem(
        name="outer_solar_system",
        rhs=rhs,
        u0=AU * places.ravel(),
        v0=AU / DAY * velocities.ravel(),
        params=GM_SUN * masses,
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="J/kg",
        names=tuple(f"{name} {axis}" for name in BODIES for axis in "xyz"),
        source="Hairer, Lubich and Wanner, Geometric Numerical Integration, section I.2.4",
        h=40 * DAY,
        draw=draw,
        view=Mechanism(places_in_au, trails=range(1, len(BODIES)), labels=("x (au)", "y (au)", "z (au)")),
    )


def places_in_au(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the places of the bodies, shape (m, 6, 3), au."""
    return u.reshape(len(u), -1, 3) / AU


def draw(figure, solution):
    """Draw the orbits of the first 250 years, and the distances from the sun and the speeds of all times."""
    t = solution.t
    x, v = (places_in_au(t, values) for values in (solution.u, AU / 1e3 * solution.v))  # v in km/s
    few = t <= t[0] + 250 * YEAR
    orbits = drawing.picture(figure, aspect="equal")
    orbits.plot(*x[few, 0, :2].T, "C1o", markersize=6, label="sun")
    panels = [drawing.time_panel(figure, label) for label in ("distance from the sun (au)", "speed of orbit (km/s)")]
    for i, (name, color) in enumerate(zip(list(BODIES)[1:], ("C0", "C2", "C3", "C4", "C5"), strict=True), start=1):
        orbits.plot(*x[few, i, :2].T, color, linewidth=0.8, label=name)
        for panel, rows in zip(panels, (x, v), strict=True):
            panel.plot(t, np.linalg.norm(rows[:, i] - rows[:, 0], axis=1), color, linewidth=0.8, label=name)
    orbits.set(xlabel="x (au)", ylabel="y (au)")
    drawing.legend(orbits)
    drawing.legend(panels[0])
