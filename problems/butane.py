"""Butane in a box: chains of four atoms, with bonds, angles and dihedral angles."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import HarmonicAngle, LennardJones, LinearSpring, PlaneContact, RyckaertBellemans
from eig3.problem import Problem
from eig3.scene import Scene

from .argon import K, view

U, MOL = 1.66053907e-27, 6.02214076e23  # kg, 1/mol
GROUPS = np.array([15.035, 14.027, 14.027, 15.035]) * U  # CH3, CH2, CH2 and CH3, each as one atom
BOND, ANGLE = 1.53e-10, np.radians(109.47)  # m, rad
TORSION = 1e3 / MOL * np.array([9.28, 12.16, -13.12, -3.06, 26.24, -31.5])  # J
WALL = 1e6  # N/m^(3/2): an atom at 700 K comes some 0.05 nm into it
DEPTH, SIZE = 72.0 * K, 3.923e-10  # J, m; between atoms of two chains
SPACING = 5.6e-10, 5.6e-10, 7.6e-10  # of the chains at the start, m


def butane(
    n: int = 3, box: float = 2.6e-9, temperature: float = 700.0, seed: int = 1975, t_end: float = 1e-11
) -> Problem:
    """Butane: n x n x n chains in a box of soft walls, which start straight, with random velocities.

    Parameters
    ----------
    n : int
        Chains along an edge of the lattice, at least 1.
    box : float
        Edge of the box around the chains, m.
    temperature : float
        Of the random velocities, K. Half of it goes into the potentials, which start near their minimum.
    seed : int
        Of the random velocities, at least 0. The momentum is 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For n below 1, and a box that does not hold the chains at the start.
    """
    if n < 1:
        raise ValueError(f"n must be at least 1, not {n}.")
    places = lattice(n)
    if not box > 2 * np.abs(places).max():
        raise ValueError(f"box must be longer than {2 * np.abs(places).max():.3g} m to hold the chains, not {box}.")
    v = np.random.default_rng(seed).standard_normal(places.shape) * np.sqrt(K * temperature / GROUPS[:, None])
    v -= np.tensordot(GROUPS, v.sum(axis=0), 1) / (len(v) * GROUPS.sum())
    scene = Scene(dimension=3)
    atoms = scene.mass(GROUPS, places, v)
    a, b, c, d = (atoms[:, k] for k in range(4))
    scene.add(LinearSpring(stiffness=361.0, rest_length=BOND), atoms[:, :-1], atoms[:, 1:])
    scene.add(HarmonicAngle(stiffness=62500 * K, angle=ANGLE), atoms[:, :-2], atoms[:, 1:-1], atoms[:, 2:])
    scene.add(RyckaertBellemans(TORSION), a, b, c, d)
    scene.add(LennardJones(DEPTH, SIZE, cutoff=2.5 * SIZE), atoms, exclude_bonded=("1-2", "1-3", "1-4"))
    for normal in (*np.eye(3), *-np.eye(3)):
        scene.add(PlaneContact(WALL, normal, -box / 2))
    problem = scene.problem((0.0, t_end), name="butane")
    return problem.with_(
        source="atoms of Ryckaert and Bellemans (1975), with bonds of OPLS (Jorgensen et al., 1984)",
        h=1e-15,
        draw=partial(draw, n=n),
        view=view(problem, 0.08),
    )


def lattice(n: int) -> np.ndarray:
    """Return the places of straight chains, m, of shape (chains, 4, 3), with their mean at 0."""
    half, across = BOND * np.sin(ANGLE / 2), BOND * np.cos(ANGLE / 2)
    chain = np.array([(0.0, (-1) ** k * across / 2, (k - 1.5) * half) for k in range(4)])
    index = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return chain + (index - (n - 1) / 2) * SPACING


def dihedrals(u: np.ndarray) -> np.ndarray:
    """Return the dihedral angle of each chain, rad from 0 (cis) to 2 pi, from displacements of shape (..., 3 n)."""
    x = np.moveaxis(u.reshape(*u.shape[:-1], 3, -1, 4), -3, -1)
    f, g, h = np.moveaxis(np.diff(x, axis=-2), -2, 0)
    a, b = np.cross(f, g), np.cross(g, h)
    sine = np.sum(np.cross(a, b) * g, axis=-1) / np.linalg.norm(g, axis=-1)
    return np.arctan2(sine, np.sum(a * b, axis=-1)) % (2 * np.pi)


def draw(figure, solution, n):
    t, m = solution.t, np.tile(GROUPS, 3 * n**3)
    angles = np.degrees(dihedrals(solution.u))
    axes = drawing.time_panel(figure, "dihedral angle\n(degrees)")
    drawing.lines(axes, t, angles[:, :3], [f"chain {k}" for k in range(min(3, n**3))])
    axes.set_yticks([60, 180, 300])
    axes.set_ylim(0, 360)
    axes = drawing.time_panel(figure, "chains in gauche\n(per cent)")
    axes.plot(t, 100 * np.mean(np.abs(angles - 180) > 60, axis=1))
    axes = drawing.time_panel(figure, "temperature\n(K)")
    axes.plot(t, solution.v**2 @ m / (K * m.size), linewidth=0.7)
