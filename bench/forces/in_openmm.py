"""The forces of OpenMM on the six points: by its forces of bonds, and by formulas that it differentiates."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..rivals.openmm import Simulation
from .systems import (
    ANGLE,
    BOND,
    CHARGES,
    CONTACT,
    DAMPING,
    DIAMETER,
    EPSILONS,
    HARDENING,
    MORSE,
    NU,
    POINTS,
    REACH,
    SIGMAS,
    TORSION,
    E,
    chains,
    places,
)


def forces(name: str) -> np.ndarray:
    """Return the forces on the points, of shape (6, 3)."""
    force = _of_pairs(name) if name in _POTENTIALS else _OF_THE_CHAIN[name]()
    x = places()
    return Simulation([force], x, 0 * x, h=1e-3).forces()


def _shifted(potential: str, slope: float) -> str:
    """Return a potential whose force is 0 at the cutoff, up to a constant."""
    return f"step({REACH} - r) * (u - r * ({slope:.17g})); u = {potential}"


def _mixture(sigma: str) -> str:
    """Return the shifted potential of two atoms with the parameters of each, with a rule for sigma."""
    at_end = f"24 * e * c * (1 - 2 * c) / {REACH}; c = (s / {REACH})^6"
    line = f"step({REACH} - r) * (4 * e * ((s / r)^12 - (s / r)^6) - r * slope); slope = {at_end}"
    return f"{line}; e = sqrt(e1 * e2); s = {sigma}"


def _slope_of_charges(damping: float) -> float:
    s = damping * REACH
    return -(math.erfc(s) / REACH + 2 / math.sqrt(math.pi) * damping * math.exp(-s * s)) / REACH


def _slope_of_morse() -> float:
    D, a, r0 = MORSE
    near = math.exp(a * (r0 - REACH))
    return 2 * D * a * near * (1 - near)


_S6 = REACH**-6
_STIFFNESS = 4 / 3 * E / (2 * (1 - NU**2)) * math.sqrt(DIAMETER / 4)  # of two equal spheres of one material
_MORSE = f"{MORSE[0]} * (1 - exp({MORSE[1]} * ({MORSE[2]} - r)))^2"
_DAMPED = _shifted(f"erfc({DAMPING} * r) / r", _slope_of_charges(DAMPING))
_POTENTIALS = {
    "contact": f"{2 / 5 * CONTACT} * max(0, {DIAMETER} - r)^2.5",
    "grains": f"{2 / 5 * _STIFFNESS} * max(0, {DIAMETER} - r)^2.5",
    "morse pairs": _shifted(_MORSE, _slope_of_morse()),
    "lennard-jones": _shifted("4 / r^12 - 4 / r^6", 24 * _S6 * (1 - 2 * _S6) / REACH),
    "mixture": _mixture("(s1 + s2) / 2"),
    "geometric mixture": _mixture("sqrt(s1 * s2)"),
    "coulomb": _shifted("1 / r", _slope_of_charges(0.0)),
    "damped coulomb": _DAMPED,
    "charges": f"q1 * q2 * {_DAMPED}",
}


def _of_pairs(name: str) -> Any:
    import openmm

    force = openmm.CustomNonbondedForce(_POTENTIALS[name])
    given = {"q": CHARGES} if name == "charges" else {"e": EPSILONS, "s": SIGMAS} if "mixture" in name else {}
    for symbol in given:
        force.addPerParticleParameter(symbol)
    for k in range(POINTS):
        force.addParticle([values[k] for values in given.values()])
    return force


def _of_chain(kind: str, *given: Any, along: int = 2, numbers: Sequence[Any] = ()) -> Any:
    """Return a force of OpenMM, made of what is given, with its bonds, angles or dihedrals along the chain."""
    import openmm

    force = getattr(openmm, kind)(*given)
    add = {2: "addBond", 3: "addAngle", 4: "addTorsion"}[along]
    for ids in chains(along):
        getattr(force, add)(*ids, *numbers)
    return force


_K, _CUBIC, _LENGTH = HARDENING
_HARDENING = f"{_K / 2} * d^2 + {_K * _CUBIC / 4} * d^4; d = r - {_LENGTH}"
_OF_THE_CHAIN: dict[str, Callable[[], Any]] = {
    "spring": partial(_of_chain, "HarmonicBondForce", numbers=BOND[::-1]),
    "hardening": partial(_of_chain, "CustomBondForce", _HARDENING, numbers=[[]]),
    "morse": partial(_of_chain, "CustomBondForce", _MORSE, numbers=[[]]),
    "angle": partial(_of_chain, "HarmonicAngleForce", along=3, numbers=ANGLE[::-1]),
    "torsion": partial(_of_chain, "RBTorsionForce", along=4, numbers=TORSION),
}
