"""Six points in space with one effect, between all pairs or along their chain."""

from __future__ import annotations

import numpy as np

from eig3.effects import (
    Coulomb,
    HardeningSpring,
    HarmonicAngle,
    HertzContact,
    HertzMindlin,
    LennardJones,
    LinearSpring,
    Morse,
    RyckaertBellemans,
)
from eig3.problem import Problem
from eig3.scene import Scene

POINTS = 6
REACH, DAMPING = 2.5, 0.8
CONTACT, DIAMETER = 500.0, 1.4
E, NU = 1e3, 0.3
BOND, ANGLE = (40.0, 1.1), (15.0, 1.9)  # stiffness, and length or angle
MORSE = 8.0, 2.5, 1.1  # D, a, r0
HARDENING = 40.0, 0.7, 1.1  # stiffness, cubic, length
EPSILONS, SIGMAS, CHARGES = (1.0,) * 3 + (0.6,) * 3, (1.0,) * 3 + (1.3,) * 3, (1.0, -0.7) * 3  # of a mixture
TORSION = (9.28, 12.16, -13.12, -3.06, 26.24, -31.5)

_BETWEEN_PAIRS = {
    "contact": HertzContact(CONTACT, DIAMETER),
    "grains": HertzMindlin(E, NU, 0.5, radii=DIAMETER / 2),
    "lennard-jones": LennardJones(1.0, 1.0, REACH),
    "mixture": LennardJones(EPSILONS, SIGMAS, REACH),
    "geometric mixture": LennardJones(EPSILONS, SIGMAS, REACH, mixing="geometric"),
    "coulomb": Coulomb(1.0, cutoff=REACH),
    "damped coulomb": Coulomb(1.0, DAMPING, REACH),
    "charges": Coulomb(1.0, DAMPING, REACH, charges=CHARGES),
    "morse pairs": Morse(*MORSE, cutoff=REACH),
}
_ALONG_THE_CHAIN = {
    "spring": LinearSpring(*BOND),
    "hardening": HardeningSpring(*HARDENING),
    "morse": Morse(*MORSE),
    "angle": HarmonicAngle(*ANGLE),
    "torsion": RyckaertBellemans(TORSION),
}
NAMES = (*_BETWEEN_PAIRS, *_ALONG_THE_CHAIN)


def places() -> np.ndarray:
    """Return the places of the points, of shape (6, 3): a bent and twisted chain."""
    k = np.arange(POINTS)
    return np.column_stack([0.9 * np.cos(1.3 * k), 0.9 * np.sin(1.3 * k), 0.35 * k + 0.1 * np.sin(5.0 * k)])


def chains(length: int) -> list[list[int]]:
    """Return the numbers of the points of each part of the chain with so many points."""
    return [list(range(k, k + length)) for k in range(POINTS - length + 1)]


def problem(name: str) -> Problem:
    """Return the scene of masses of 1 kg with this effect."""
    scene = Scene(3)
    points = scene.mass(1.0, places())
    if name in _BETWEEN_PAIRS:
        scene.add(_BETWEEN_PAIRS[name], points)
    else:
        effect = _ALONG_THE_CHAIN[name]
        length = {"angle": 3, "torsion": 4}.get(name, 2)
        scene.add(effect, *(points[list(column)] for column in zip(*chains(length), strict=True)))
    return scene.problem((0.0, 1.0))
