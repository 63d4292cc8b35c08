"""A curtain that falls: a net of springs in air, held at two corners."""

from dataclasses import replace
from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, LinearDamper, LinearSpring, QuadraticDrag
from eig3.problem import Problem
from eig3.scene import Scene

G = 9.81
SQUARES = 18  # along a side of the cloth in the animation
LIGHT = np.array([0.6, -0.64, 0.48])  # direction of the light in the animation
SURFACE = np.array([0.35, 0.62, 0.9])  # colour of the cloth


def curtain(
    n: int = 40,
    side: float = 1.0,
    m: float = 0.2,
    stiffness: float = 100.0,
    damping: float = 1e-3,
    drag: float = 0.6,
    t_end: float = 3.0,
    work: bool = False,
) -> Problem:
    """A square cloth of n x n points that starts level and is held at two corners; u has all x, then all y, then all z.

    Parameters
    ----------
    n : int
        Points along a side, at least 3.
    side : float
        m.
    m : float
        Mass of the whole cloth, kg.
    stiffness : float
        Stiffness of the threads between points, N/m; diagonals have a tenth of it.
    damping : float
        Damping of the threads, N s/m.
    drag : float
        Drag of the whole cloth: half the product of density, area and drag coefficient, kg/m.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the air and the damping.

    Raises
    ------
    ValueError
        For fewer than three points along a side.
    """
    if n < 3:
        raise ValueError(f"n must be at least 3, not {n}.")
    spacing = side / (n - 1)
    grid = np.stack(np.meshgrid(np.arange(n) * spacing, np.arange(n) * spacing, [0.0], indexing="ij"), -1)[:, :, 0]
    scene = Scene(dimension=3)
    cloth = scene.mass(m / n**2, grid)
    corners = cloth[0, [0, -1]]
    scene.add(LinearSpring(10 * stiffness), scene.fixed(grid[0, [0, -1]]), corners)
    for a, b in ((cloth[:-1], cloth[1:]), (cloth[:, :-1], cloth[:, 1:])):
        scene.add(LinearSpring(stiffness, spacing), a, b)
        scene.add(LinearDamper(damping), a, b)
    for a, b in ((cloth[:-1, :-1], cloth[1:, 1:]), (cloth[:-1, 1:], cloth[1:, :-1])):
        scene.add(LinearSpring(stiffness / 10, spacing * np.sqrt(2)), a, b)
    scene.add(Gravity((0, 0, -G)))
    scene.add(QuadraticDrag(drag / n**2))

    problem = scene.problem((0.0, t_end), name="curtain", work=work)
    return problem.with_(
        source="mass-spring cloth of computer graphics, after Provot (1995)",
        h=2e-4,
        draw=partial(draw, n=n, side=side),
        view=partial(view, n=n, side=side, mechanism=surface(problem, cloth.numbers)),
    )


def surface(problem, numbers):
    """Return the view of the scene as a surface of squares between its points, of which `numbers` has the numbers."""
    squares = np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]], axis=-1)
    return replace(problem.view, links=(), springs=(), faces=squares.reshape(-1, 4), hidden=numbers.ravel())


def view(figure, film, n, side, mechanism):
    """Show the cloth as a surface, light where it faces the light; `mechanism` is for pages, which show all squares."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    some = np.unique(np.linspace(0, n - 1, SQUARES + 1).round().astype(int))
    corners = np.moveaxis(film.u.reshape(-1, 3, n, n), 1, -1)[:, some[:, None], some]
    sides = np.stack([corners[:, i : i - 1 or None, j : j - 1 or None] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], 3)
    sides = sides.reshape(len(film.t), -1, 4, 3)
    normals = np.cross(sides[:, :, 2] - sides[:, :, 0], sides[:, :, 3] - sides[:, :, 1])
    light = np.abs(normals @ LIGHT) / np.linalg.norm(normals, axis=-1)
    colors = (0.2 + 0.8 * light[..., None]) * SURFACE
    low, high = (extreme(corners, axis=(0, 1, 2)) for extreme in (np.min, np.max))
    axes = figure.add_subplot(projection="3d", azim=-40, elev=20)
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", yticks=(0, side), zticks=(-side, -side / 2, 0))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=0.95)
    axes.locator_params(axis="x", nbins=4)
    cloth = axes.add_collection3d(Poly3DCollection(sides[0], linewidth=0, antialiased=False))
    axes.plot([0, 0], [0, side], [0, 0], "k^", markersize=7)

    def show(i):
        cloth.set_verts(sides[i])
        cloth.set_facecolor(colors[i])

    return show


def draw(figure, solution, n, side):
    coordinates = solution.u.reshape(-1, 3, n, n)
    for share in (0, 1 / 6, 1 / 2):
        k = np.abs(solution.t - share * solution.t[-1]).argmin()
        axes = drawing.picture(figure, projection="3d")
        axes.plot_wireframe(*coordinates[k], rcount=n // 2, ccount=n // 2, linewidth=0.5)
        axes.scatter([0, 0], [0, side], [0, 0], color="C3", s=12)
        axes.set(title=f"t = {solution.t[k]:.2g} s", xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
        axes.set(xlim=(-side, side), ylim=(0, side), zlim=(-1.3 * side, 0.2 * side))
        axes.set(xticks=(-side, 0, side), yticks=(side,), zticks=(-side, 0))
        axes.set_box_aspect((2, 1, 1.5), zoom=0.8)
    for j, name in ((0, "x"), (2, "z")):
        axes = drawing.time_panel(figure, f"{name} of the free edge\n(m)")
        drawing.lines(axes, solution.t, coordinates[:, j, -1, [n // 2, 0]], ["middle", "corner"])
