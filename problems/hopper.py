"""A hopper: discs that fall through the opening of a funnel onto the floor."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, HertzMindlin, PlaneContact
from eig3.problem import Problem
from eig3.scene import Scene

G = 9.81
DIAMETER = 0.01  # m
MASS = 2500.0 * np.pi / 4 * DIAMETER**3  # kg; the discs are as thick as wide
E, NU, RESTITUTION = 5e6, 0.3, 0.6  # Pa: soft discs, so that a contact lasts a millisecond
FLOOR_STIFFNESS, DAMPING, SLIP = 2e5, 0.3, 0.05  # N/m^(3/2), s/m, m/s
SPACING = 0.98  # at the start, in diameters: the largest discs touch
WIDTH, OPENING, FLOOR = 70, 9, 30  # of the discs above the funnel, of its opening, and below it, in diameters


def hopper(
    n: int = 5000, opening: float = OPENING, friction: float = 0.5, seed: int = 1895, t_end: float = 0.5
) -> Problem:
    """Discs in a funnel with walls at 45 degrees and an opening at the height 0.

    Parameters
    ----------
    n : int
        Number of discs, at least 1.
    opening : float
        Its width, in diameters of a disc, below 70.
    friction : float
        Coefficient of friction of the discs, on each other, on the walls and on the floor.
    seed : int
        Of the small differences of the sizes of the discs, at least 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For no disc, or an opening that is not between 1 and 70 diameters.
    """
    if n < 1:
        raise ValueError(f"n must be at least 1, not {n}.")
    if not 1 <= opening < WIDTH:
        raise ValueError(f"opening must be from 1 to {WIDTH} diameters, not {opening}.")
    rng = np.random.default_rng(seed)
    scene = Scene(dimension=2)
    places = filling(n, opening) + rng.uniform(-0.01, 0.01, (n, 2)) * DIAMETER
    grains = scene.mass(MASS, places, inertia=MASS * DIAMETER**2 / 8)
    walls = scene.fixed(funnel(n, opening))
    scene.add(HertzMindlin(E, NU, friction, RESTITUTION, radii=DIAMETER / 2 * rng.uniform(0.9, 1.0, n)), grains)
    scene.add(HertzMindlin(E, NU, friction, RESTITUTION, radii=DIAMETER / 2), grains, others=walls)
    scene.add(PlaneContact(FLOOR_STIFFNESS, (0, 1), -FLOOR * DIAMETER, DAMPING, friction, SLIP), grains)
    scene.add(Gravity((0, -G)))
    return scene.problem((0.0, t_end), name="hopper").with_(
        source="contacts of Hertz and Mindlin with friction",
        h=1e-4,
        draw=partial(draw, n=n),
    )


def funnel(n: int, opening: float) -> np.ndarray:
    """Return the places of the discs of the walls, m, half a diameter from each other."""
    slope = np.arange(0.0, (WIDTH - opening) / 2 + 0.25, 0.25 * np.sqrt(2))
    top = slope[-1] + 1.5 * n / WIDTH
    shaft = np.arange(slope[-1] + 0.5, top, 0.5)
    along, up = np.concatenate([slope, np.full(shaft.size, slope[-1])]), np.concatenate([slope, shaft])
    right = np.column_stack([opening / 2 + 0.5 + along, up])
    return DIAMETER * np.concatenate([right, right * (-1, 1)])


def filling(n: int, opening: float) -> np.ndarray:
    """Return the places of the discs at the start, m: rows above the opening, as wide as the funnel."""
    rows: list[np.ndarray] = []
    y = 2.0
    while sum(len(row) for row in rows) < n:
        half = min(opening / 2 + y - 1.5, (WIDTH - 1) / 2)
        x = np.arange(-half, half + 1e-9, SPACING)
        rows.append(np.column_stack([x - x.mean(), np.full(x.size, y)]))
        y += SPACING
    return DIAMETER * np.concatenate(rows)[:n]


def draw(figure, solution, n):
    y = solution.u[:, n : 2 * n]
    axes = drawing.time_panel(figure, "discs below the\nopening (number)")
    axes.plot(solution.t, (y < 0).sum(axis=1))
    axes = drawing.time_panel(figure, "kinetic energy\n(J)")
    v = solution.v[:, : 2 * n]
    axes.plot(solution.t, MASS / 2 * np.einsum("ij,ij->i", v, v))
