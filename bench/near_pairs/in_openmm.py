"""Argon in OpenMM: with the same shifted force as a formula, and with its own force of Lennard-Jones, which jumps."""

from __future__ import annotations

from typing import Any

from eig3.problem import Problem

from ..rivals.openmm import Simulation
from .atoms import REACH, Reduced

_S6 = REACH**-6
_SLOPE, _DEPTH = 24 * _S6 * (1 - 2 * _S6) / REACH, 4 * _S6 * (_S6 - 1)  # of the potential at the cutoff
_SHIFTED = f"4 * q * (q - 1) - ({_DEPTH:.17g}) - (r - {REACH}) * ({_SLOPE:.17g}); q = 1 / r^6"


def simulation(problem: Problem, platform: str = "Reference", threads: int = 1, *, jumps: bool = False) -> Simulation:
    """Return OpenMM with the atoms at their start.

    With `jumps`, the force is cut off at the cutoff without a shift: only so OpenMM has it without a formula.
    """
    atoms = Reduced.of(problem)
    force = _cut_off(len(atoms.places)) if jumps else _shifted(len(atoms.places))
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(REACH)
    return Simulation([force], atoms.places, atoms.speeds, atoms.h, box=atoms.side, platform=platform, threads=threads)


def _shifted(n: int) -> Any:
    import openmm

    force = openmm.CustomNonbondedForce(_SHIFTED)
    for _ in range(n):
        force.addParticle([])
    return force


def _cut_off(n: int) -> Any:
    import openmm

    force = openmm.NonbondedForce()
    force.setUseDispersionCorrection(False)
    for _ in range(n):
        force.addParticle(0.0, 1.0, 1.0)
    return force
