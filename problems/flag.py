"""A flag in the wind: a sheet of triangles that bends."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, HingeBending, LinearDamper, StVenantKirchhoffMembrane, WindPressure
from eig3.problem import Problem
from eig3.scene import Scene, edges, hinges

G = 9.81
THICKNESS = 2e-4  # m


def flag(
    n: int = 13,
    height: float = 0.8,
    length: float = 1.2,
    E: float = 5e6,
    rigidity: float = 2e-5,
    wind: float = 8.0,
    damping: float = 2e-3,
    t_end: float = 4.0,
    work: bool = False,
) -> Problem:
    """A flag on a pole at x = 0 in wind along x, which starts level, a little wavy and at rest.

    Parameters
    ----------
    n : int
        Points along the pole, at least 2.
    height, length : float
        Of the cloth, m.
    E : float
        Young's modulus of the cloth, 0.2 mm thick, Pa.
    rigidity : float
        Bending rigidity of the cloth, N m.
    wind : float
        Speed of the wind, m/s.
    damping : float
        Damping along each edge of a triangle, N s/m.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the wind and the damping.

    Raises
    ------
    ValueError
        For fewer than two points along the pole.
    """
    if n < 2:
        raise ValueError(f"n must be at least 2, not {n}.")
    m = round(length / height * (n - 1)) + 1
    cells = sheet(m, n)
    flat = np.stack(np.meshgrid(np.linspace(0, length, m), [0.0], np.linspace(0, height, n), indexing="ij"), axis=-1)
    flat = flat.reshape(-1, 3)
    wavy = flat.copy()
    wavy[:, 1] = 0.02 * length * np.sin(2 * np.pi * flat[:, 0] / length) * flat[:, 0] / length
    scene = Scene(dimension=3)
    membrane = StVenantKirchhoffMembrane(E, nu=0.3, thickness=THICKNESS)
    cloth = scene.add_mesh(wavy, cells, membrane, density=700.0, fixed=np.arange(n), rest=flat)
    scene.add(HingeBending(rigidity), *cloth[hinges(cells)])
    ends = edges(cells)
    scene.add(LinearDamper(damping), *cloth[ends[:, ends[1] >= n]])
    scene.add(WindPressure(1.2, (wind, 0.0, 0.0), coefficient=1.2), *cloth[cells.T])
    scene.add(Gravity((0, 0, -G)))
    return scene.problem((0.0, t_end), name="flag", work=work).with_(
        source="constant-strain triangles in plane stress; hinges of Grinspun et al. (2003); pressure of the wind",
        h=1e-4,
        draw=partial(draw, cloth=flat.reshape(m, n, 3)),
    )


def sheet(m: int, n: int) -> np.ndarray:
    """Return the triangles of a net of m x n points: the diagonals of neighbouring squares meet."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(m - 1), np.arange(n - 1), indexing="ij"))
    a, b, c, d = (n * (i + s) + j + r for s, r in ((0, 0), (1, 0), (1, 1), (0, 1)))
    is_even = (i + j) % 2 == 0
    first = np.where(is_even, [a, b, c], [a, b, d])
    return np.concatenate([first.T, np.where(is_even, [a, c, d], [b, c, d]).T])


def draw(figure, solution, cloth):
    m, n, _ = cloth.shape
    places = solution.u.reshape(len(solution.t), 3, m - 1, n)
    for k, name in ((0, "x"), (1, "y"), (2, "z")):
        axes = drawing.time_panel(figure, f"{name} of the free edge\n(m)")
        drawing.lines(axes, solution.t, places[:, k, -1, [-1, n // 2, 0]], ["top", "middle", "bottom"])
