"""A crystal of table salt: ions in a periodic box, with Ewald's sum."""

import numpy as np

from eig3 import drawing
from eig3.effects import Ewald, LennardJones
from eig3.problem import Problem
from eig3.scene import Scene

from .argon import K, view
from .butane import MOL, U

COULOMB = 8.9875517923e9 * 1.602176634e-19**2  # of two elementary charges, N m^2
DISTANCE = 2.82e-10  # of a sodium and a chloride ion in the crystal, m
MASSES = np.array([22.98977, 35.453]) * U  # of sodium and chloride, kg
DEPTHS = np.array([0.3526418, 0.0127850]) * 4184 / MOL  # J
SIZES = np.array([1.212e-10, 2.711e-10]) * 2 ** (5 / 6)  # m; from half the distances of the minima


def sodium_chloride(
    n: int = 3, distance: float = DISTANCE, temperature: float = 600.0, seed: int = 2008, t_end: float = 1e-12
) -> Problem:
    """A crystal of 8 n^3 ions of table salt in a periodic cube, which start on its lattice with random velocities.

    Parameters
    ----------
    n : int
        Cells of the crystal along an edge of the cube, at least 2.
    distance : float
        Of neighbouring ions at the start, m.
    temperature : float
        Of the random velocities, K. Half of it goes into the potentials, which start at their minimum.
    seed : int
        Of the random velocities, at least 0. The momentum is 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For n below 2.
    """
    if n < 2:
        raise ValueError(f"n must be at least 2, not {n}.")
    index = np.stack(np.meshgrid(*[np.arange(2 * n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    kind = index.sum(axis=1) % 2
    m, side = MASSES[kind], 2 * n * distance
    v = np.random.default_rng(seed).standard_normal(index.shape) * np.sqrt(K * temperature / m[:, None])
    scene = Scene(dimension=3, box=[side] * 3)
    ions = scene.mass(m, distance * (index + 0.5), v - m @ v / m.sum())
    cutoff = min(0.5 * side, 9e-10)
    scene.add(LennardJones(DEPTHS[kind], SIZES[kind], cutoff), ions)
    scene.add(Ewald(COULOMB, 1.0 - 2.0 * kind, cutoff, accuracy=1e-5), ions)
    problem = scene.problem((0.0, t_end), name="sodium_chloride")
    return problem.with_(
        source="the ions of I. S. Joung and T. E. Cheatham, Journal of Physical Chemistry B 112 (2008) 9020, for SPC/E",
        h=2e-15,
        draw=draw,
        view=view(problem, SIZES[kind] / 2 * 1e9),
    )


def draw(figure, solution):
    u, v = (x.reshape(len(solution.t), 3, -1) for x in (solution.u, solution.v))
    kind = np.indices([round((u.shape[2]) ** (1 / 3))] * 3).sum(axis=0).ravel() % 2
    axes = drawing.time_panel(figure, "temperature\n(K)")
    axes.plot(solution.t, np.einsum("tki,tki,i->t", v, v, MASSES[kind]) / (3 * K * kind.size))
    axes = drawing.time_panel(figure, "mean square\ndisplacement (nm²)")
    for which, name in enumerate(("sodium", "chloride")):
        moved = (u - u[0])[:, :, kind == which]
        axes.plot(solution.t, 1e18 * np.mean(np.sum(moved**2, axis=1), axis=1), label=name)
    axes.legend()
