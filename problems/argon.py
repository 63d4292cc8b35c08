"""Liquid argon: atoms in a periodic box, with pair forces up to a cutoff."""

from dataclasses import replace

import numpy as np

from eig3 import drawing
from eig3.animation import Magnified
from eig3.effects import LennardJones
from eig3.problem import Problem
from eig3.scene import Scene

K, MASS = 1.380649e-23, 39.948 * 1.66053907e-27  # J/K, kg
DEPTH, SIZE = 119.8 * K, 3.405e-10  # J, m


def argon(
    n: int = 10, density: float = 1374.0, temperature: float = 190.0, seed: int = 1964, t_end: float = 4e-12
) -> Problem:
    """4 n^3 atoms of argon in a periodic cube, which start on a lattice with random velocities.

    Parameters
    ----------
    n : int
        Cells of the lattice along an edge of the cube, at least 4.
    density : float
        kg/m^3.
    temperature : float
        Of the random velocities, K. Half of it goes into the potentials, which start at their minimum.
    seed : int
        Of the random velocities, at least 0. The momentum is 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For n below 4, and a cube that is shorter than twice the cutoff of the forces.
    """
    if n < 4:
        raise ValueError(f"n must be at least 4, not {n}.")
    cell = (4 * MASS / density) ** (1 / 3)
    corners = np.array([(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 0)]) / 2
    index = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    places = cell * (index + corners + 0.25).reshape(-1, 3)
    v = np.random.default_rng(seed).standard_normal(places.shape) * np.sqrt(K * temperature / MASS)
    scene = Scene(dimension=3, box=[n * cell] * 3)
    atoms = scene.mass(MASS, places, v - v.mean(axis=0))
    scene.add(LennardJones(DEPTH, SIZE, cutoff=2.5 * SIZE), atoms)
    problem = scene.problem((0.0, t_end), name="argon")
    return problem.with_(
        source="the liquid of A. Rahman, Physical Review 136 (1964) A405, with a shifted force",
        h=4e-15,
        draw=draw,
        view=view(problem, SIZE / 2 * 1e9),
    )


def view(problem, radius):
    """Show the atoms as balls of a radius, in nm, without walls."""
    start = np.zeros((problem.u0.size // 3, 3))
    return replace(
        problem.view,
        places=Magnified(problem.view.places, 1e9, start),
        planes=(),
        radii=np.full(len(start), radius),
        labels=("x (nm)", "y (nm)", "z (nm)"),
        box=[1e9 * side for side in problem.view.box],
    )


def draw(figure, solution):
    t, count = solution.t, solution.u.shape[1]
    axes = drawing.time_panel(figure, "temperature\n(K)")
    axes.plot(t, MASS * np.einsum("ij,ij->i", solution.v, solution.v) / (K * count))
    axes = drawing.time_panel(figure, "mean square\ndisplacement (nm²)")
    axes.plot(t, 3e18 * np.mean((solution.u - solution.u[0]) ** 2, axis=1))
