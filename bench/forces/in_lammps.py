"""The forces of LAMMPS on the six points, by its own styles."""

from __future__ import annotations

import math

import numpy as np

from ..rivals.lammps import Simulation
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
    REACH,
    SIGMAS,
    TORSION,
    E,
    chains,
    places,
)

#: Where LAMMPS itself is not exact to 1e-10: its coul/dsf has erfc from a formula with errors of some 1e-7.
TOLERANCES = {"coulomb": 1e-8, "damped coulomb": 1e-6, "charges": 1e-6}

_NO_PAIRS = "pair_style zero 5.0\npair_coeff * *"
_COULOMB = f"set group all charge 1.0\npair_style coul/dsf {{}} {REACH}\npair_coeff * *"
_KINDS = "set atom 1*3 type 1\nset atom 4*6 type 2"
_CHARGES = "\n".join(f"set atom {k + 1} charge {q}" for k, q in enumerate(CHARGES))


def forces(name: str) -> np.ndarray:
    """Return the forces on the points, of shape (6, 3)."""
    x, of_spheres = places(), name in ("contact", "grains")
    before = f"""units lj
atom_style {"sphere" if of_spheres else "full"}
atom_modify map array
boundary f f f
newton on
region box block -9 9 -9 9 -9 9
create_box 2 box {"" if of_spheres else _ROOM}
special_bonds lj/coul 1 1 1
comm_modify cutoff 8 vel yes"""
    mass = "set group all mass 1.0" if of_spheres else "mass * 1.0"
    return Simulation(before, f"{_STYLES[name]}\n{mass}\nfix motion all nve", x, 0 * x).forces()


def _mixture(rule: str) -> str:
    """Return the commands for the atoms of two types, whose pairs LAMMPS mixes."""
    kinds = [f"pair_coeff {k} {k} {EPSILONS[3 * k - 1]} {SIGMAS[3 * k - 1]}" for k in (1, 2)]
    return "\n".join([_KINDS, f"pair_style lj/smooth/linear {REACH}", *kinds, f"pair_modify mix {rule}"])


def _contact() -> str:
    normal = CONTACT / math.sqrt(DIAMETER / 4)  # LAMMPS has the root of the radius of two equal spheres in series
    return f"""set group all diameter {DIAMETER}
pair_style gran/hertz/history {normal:.17g} 0.0 0.0 0.0 0.0 0
pair_coeff * *"""


def _grains() -> str:
    law = f"hertz/material {E} 1.0 {NU} tangential mindlin_rescale/force NULL 1.0 0.5 damping coeff_restitution"
    return f"set group all diameter {DIAMETER}\npair_style granular\npair_coeff * * {law} limit_damping"


def _hardening() -> str:
    stiffness, cubic, length = HARDENING
    return _chain("bond", f"class2 {length} {stiffness / 2} 0.0 {stiffness * cubic / 4:.17g}")


def _chain(kind: str, style: str) -> str:
    """Return the commands for a style of bonds, angles or dihedrals along the chain."""
    members = chains({"bond": 2, "angle": 3, "dihedral": 4}[kind])
    lines = [f"create_bonds single/{kind} 1 {' '.join(str(k + 1) for k in ids)}" for ids in members]
    name, *numbers = style.split()
    return "\n".join([_NO_PAIRS, f"{kind}_style {name}", f"{kind}_coeff 1 {' '.join(numbers)}", *lines])


def _torsion() -> str:
    """Return the polynomial in cos phi; the effect has a polynomial in -cos phi."""
    signed = [f"{(-1) ** k * c:.17g}" for k, c in enumerate(TORSION)]
    return _chain("dihedral", f"nharmonic {len(signed)} {' '.join(signed)}")


_ROOM = " ".join(f"{kind}/types 1 extra/{kind}/per/atom 6" for kind in ("bond", "angle", "dihedral"))
_STYLES = {
    "contact": _contact(),
    "grains": _grains(),
    "lennard-jones": f"pair_style lj/smooth/linear {REACH}\npair_coeff * * 1.0 1.0",
    "mixture": _mixture("arithmetic"),
    "geometric mixture": _mixture("geometric"),
    "coulomb": _COULOMB.format(0.0),
    "damped coulomb": _COULOMB.format(DAMPING),
    "charges": f"{_CHARGES}\npair_style coul/dsf {DAMPING} {REACH}\npair_coeff * *",
    "morse pairs": f"pair_style morse/smooth/linear {REACH}\npair_coeff * * {MORSE[0]} {MORSE[1]} {MORSE[2]}",
    "hardening": _hardening(),
    "spring": _chain("bond", f"harmonic {BOND[0] / 2} {BOND[1]}"),
    "morse": _chain("bond", f"morse {MORSE[0]} {MORSE[1]} {MORSE[2]}"),
    "angle": _chain("angle", f"harmonic {ANGLE[0] / 2} {math.degrees(ANGLE[1]):.17g}"),
    "torsion": _torsion(),
}
