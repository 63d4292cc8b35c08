"""A column of spheres that collapses and spreads on the floor."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, HertzMindlin, PlaneContact
from eig3.problem import Problem
from eig3.scene import Scene

G = 9.81
DIAMETER = 0.01  # m
MASS = 2500.0 * np.pi / 6 * DIAMETER**3  # kg
E, NU, RESTITUTION = 5e6, 0.3, 0.5  # Pa: soft spheres, so that a contact lasts a millisecond
FLOOR, DAMPING, SLIP = 2e5, 0.5, 0.05  # N/m^(3/2), s/m, m/s
SLENDERNESS = 2.0  # the height of the column beside its diameter


def sand_column(n: int = 20_000, friction: float = 0.5, seed: int = 2004, t_end: float = 0.5) -> Problem:
    """About n spheres in a cylinder, which are released at t = 0.

    Parameters
    ----------
    n : int
        Number of spheres, at least 10.
    friction : float
        Coefficient of friction between spheres, and of spheres on the floor.
    seed : int
        Of the small differences of the sizes of the spheres, at least 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For fewer than 10 spheres.
    """
    if n < 10:
        raise ValueError(f"n must be at least 10, not {n}.")
    places = cylinder(n)
    rng = np.random.default_rng(seed)
    scene = Scene(dimension=3)
    jitter = rng.uniform(-0.01, 0.01, places.shape) * DIAMETER
    grains = scene.mass(MASS, places + jitter, inertia=MASS * DIAMETER**2 / 10)
    radii = DIAMETER / 2 * rng.uniform(0.9, 1.0, len(places))
    scene.add(HertzMindlin(E, NU, friction, RESTITUTION, radii=radii), grains)
    scene.add(PlaneContact(FLOOR, (0, 0, 1), 0.0, DAMPING, friction, SLIP), grains)
    scene.add(Gravity((0, 0, -G)))
    return scene.problem((0.0, t_end), name="sand_column").with_(
        source="contacts of Hertz and Mindlin with friction; the collapse of G. Lube et al., J. Fluid Mech. 508 (2004)",
        h=1e-4,
        draw=partial(draw, n=len(places)),
    )


def cylinder(n: int) -> np.ndarray:
    """Return the places of n spheres in a cylinder, m: on a lattice, from the floor up."""
    spacing = 1.02 * DIAMETER
    radius = (n / (2 * np.pi * SLENDERNESS)) ** (1 / 3)  # in spacings
    side = np.arange(-np.ceil(radius), np.ceil(radius) + 1)
    disc = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= radius]
    k = np.arange(n)
    return spacing * np.column_stack([disc[k % len(disc)], k // len(disc) + 0.5])


def draw(figure, solution, n):
    x, y, z = solution.u[:, : 3 * n].reshape(-1, 3, n).transpose(1, 0, 2)
    axes = drawing.time_panel(figure, "height (m)")
    drawing.lines(axes, solution.t, np.quantile(z, [0.5, 0.99], axis=1).T, ["half of the spheres", "99 per cent"])
    axes = drawing.time_panel(figure, "radius (m)")
    r = np.hypot(x, y)
    drawing.lines(axes, solution.t, np.quantile(r, [0.5, 0.99], axis=1).T, ["half of the spheres", "99 per cent"])
