"""Argon in LAMMPS, with the same shifted force."""

from __future__ import annotations

from eig3.problem import Problem

from ..rivals.lammps import Simulation
from .atoms import REACH, SKIN, Reduced


def simulation(problem: Problem, threads: int | None = 1) -> Simulation:
    """Return LAMMPS with the atoms at their start."""
    atoms = Reduced.of(problem)
    before = f"""units lj
atom_style atomic
atom_modify map array
boundary p p p
region box block 0 {atoms.side:.17g} 0 {atoms.side:.17g} 0 {atoms.side:.17g}
create_box 1 box
mass 1 1.0
pair_style lj/smooth/linear {REACH}
pair_coeff 1 1 1.0 1.0
neighbor {SKIN} bin
neigh_modify every 1 delay 0 check yes
timestep {atoms.h:.17g}
thermo 1000000000"""
    return Simulation(before, "fix motion all nve", atoms.places, atoms.speeds, threads)
