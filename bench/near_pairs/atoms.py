"""Liquid argon: the state at which the runs begin, and its numbers in units of SIZE, DEPTH and MASS."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eig3.effects import LennardJones
from eig3.problem import Problem
from eig3.problems.argon import DEPTH, MASS, SIZE, argon
from eig3.scene import Scene

from .spheres import rows

REACH = 2.5  # of the forces
SKIN = 0.3  # as in the scene to two digits, and as usual for liquids in LAMMPS
_DENSITY = 1374.0  # kg/m^3
_TIME = SIZE * math.sqrt(MASS / DEPTH)
_MELTED = 300  # steps until the lattice has become a liquid


def liquid(side: int, threads: int = 1) -> Problem:
    """Return 4 side^3 atoms of argon, with the state in which they have left their lattice."""
    problem = argon(n=side, density=_DENSITY)
    assert problem.h is not None
    run = problem.integrate(h=problem.h, t_end=_MELTED * problem.h, save_every=None)
    places, speeds = rows(run.u[-1]), rows(run.v[-1])
    scene = Scene(3, box=[_edge(len(places))] * 3)
    scene.add(LennardJones(DEPTH, SIZE, REACH * SIZE), scene.mass(MASS, places, speeds))
    return replace(scene.problem(problem.t_span, name="argon", threads=threads), h=problem.h)


def _edge(n: int) -> float:
    """Return the edge of the box of n atoms, m."""
    return (n * MASS / _DENSITY) ** (1 / 3)


@dataclass(frozen=True)
class Reduced:
    """The numbers of a problem of argon: the places are in the box, whose edge is `side`."""

    places: np.ndarray
    speeds: np.ndarray
    side: float
    h: float

    @classmethod
    def of(cls, problem: Problem) -> Reduced:
        assert problem.h is not None
        places = rows(problem.u0) / SIZE
        side = _edge(len(places)) / SIZE
        return cls(places % side, rows(problem.v0) * _TIME / SIZE, side, problem.h / _TIME)


def accelerations(forces: np.ndarray) -> np.ndarray:
    """Return the accelerations in m/s^2, in the order of the scene, from forces of shape (n, 3)."""
    return forces.T.ravel() * DEPTH / (SIZE * MASS)
