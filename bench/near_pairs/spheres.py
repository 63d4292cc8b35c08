"""Elastic spheres as a scene: with Hertz's contact, and with a linear one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import eig3
from eig3.effects import HertzContact, Link
from eig3.problem import Problem
from eig3.scene import Scene

STIFFNESS, REACH, H = 1e3, 1.0, 1e-3
SKIN = 0.2  # as in a scene of spheres


@dataclass(frozen=True, eq=False)
class LinearContact(Link):
    """A contact whose force is stiffness (contact_distance - r)."""

    stiffness: float
    contact_distance: float

    nonnegative = ("stiffness", "contact_distance")
    cutoff_field = "contact_distance"

    @staticmethod
    @eig3.jit
    def tension(r, stiffness, contact_distance):
        return -stiffness * max(0.0, contact_distance - r)

    @staticmethod
    @eig3.jit
    def potential(r, stiffness, contact_distance):
        return stiffness / 2 * max(0.0, contact_distance - r) ** 2


def spheres(n: int, contact: Link | None = None, threads: int = 1) -> Problem:
    """Return n elastic spheres, almost a lattice in contact, which move apart and meet.

    Their contact is Hertz's if no other contact is given.
    """
    rng = np.random.default_rng(0)
    side = math.ceil(round(n ** (1 / 3), 6))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)[:n]
    scene = Scene(3)
    places = 0.98 * lattice + rng.uniform(-0.05, 0.05, (n, 3))
    balls = scene.mass(1.0, places, 0.5 * rng.standard_normal((n, 3)))
    scene.add(contact or HertzContact(STIFFNESS, REACH), balls)
    return scene.problem((0.0, 1.0), name=f"{n} spheres", threads=threads)


def linear(n: int, threads: int = 1) -> Problem:
    """Return the spheres with a linear contact."""
    return spheres(n, LinearContact(STIFFNESS, REACH), threads)


def rows(values: ArrayLike) -> np.ndarray:
    """Return the vectors of the points, of shape (n, 3), from displacements or velocities of the scene."""
    return np.ascontiguousarray(np.reshape(values, (3, -1)).T)
