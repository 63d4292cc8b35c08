"""A cube of jelly that falls on a table."""

from functools import partial
from itertools import permutations

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, LinearDamper, NeoHookean, PlaneContact
from eig3.problem import Problem
from eig3.scene import Scene, edges

G = 9.81


def jelly(
    n: int = 6,
    side: float = 0.06,
    E: float = 2e4,
    nu: float = 0.4,
    damping: float = 0.1,
    height: float = 0.06,
    t_end: float = 0.8,
    work: bool = False,
) -> Problem:
    """A cube of tetrahedra with n x n x n points, which starts above a rough table, tilted and at rest.

    Parameters
    ----------
    n : int
        Points along an edge, at least 2.
    side : float
        m.
    E : float
        Young's modulus, Pa.
    nu : float
        Poisson's ratio.
    damping : float
        Damping along each edge of a tetrahedron, N s/m.
    height : float
        Of the lowest corner above the table, m.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the damping and the table.

    Raises
    ------
    ValueError
        For fewer than two points along an edge.
    """
    if n < 2:
        raise ValueError(f"n must be at least 2, not {n}.")
    points, cells = cube(n)
    points = side * points @ tilt(0.3, 0.2).T
    points[:, 2] += height - points[:, 2].min()
    scene = Scene(dimension=3)
    body = scene.add_mesh(points, cells, NeoHookean(E, nu), density=1000.0)
    scene.add(LinearDamper(damping), *body[edges(cells)])
    scene.add(PlaneContact(2e4, (0, 0, 1), damping=0.5, friction=0.3, regularization_speed=0.1), body)
    scene.add(Gravity((0, 0, -G)))
    return scene.problem((0.0, t_end), name="jelly", work=work).with_(
        source="a neo-Hookean solid of constant-strain tetrahedra; contact of Hertz with each point of the surface",
        h=2.5e-5,
        draw=partial(draw, n=n),
    )


def cube(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of a unit cube and its tetrahedra: each of its small cubes is cut into six, as by Kuhn."""
    steps = np.linspace(0, 1, n)
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    corners = np.arange(n**3).reshape(n, n, n)[:-1, :-1, :-1].ravel()
    cells = []
    for way in permutations((n * n, n, 1)):
        path = np.cumsum([0, *way])
        is_even = (way[0] > way[1]) + (way[1] > way[2]) + (way[0] > way[2]) in (1, 3)
        cells.append(corners[:, None] + (path if is_even else path[[0, 2, 1, 3]]))
    return points, np.concatenate(cells)


def tilt(about_x: float, about_y: float) -> np.ndarray:
    """Return the matrix of a rotation about x and then about y, rad."""
    c, s = np.cos(about_x), np.sin(about_x)
    d, e = np.cos(about_y), np.sin(about_y)
    return np.array([[d, 0, e], [0, 1, 0], [-e, 0, d]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def draw(figure, solution, n):
    places = solution.u.reshape(-1, 3, n, n, n)
    mean = 1e3 * places.mean(axis=(2, 3, 4))
    edge = 1e3 * np.linalg.norm(places[:, :, -1, -1, -1] - places[:, :, 0, 0, 0], axis=1)
    axes = drawing.time_panel(figure, "height of the middle\n(mm)")
    axes.plot(solution.t, mean[:, 2])
    axes = drawing.time_panel(figure, "length of a diagonal\n(mm)")
    axes.plot(solution.t, edge)
