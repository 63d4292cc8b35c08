"""The spheres of a scene in LAMMPS, with its contact of Hertz without friction and damping."""

from __future__ import annotations

from eig3.problem import Problem

from ..rivals.lammps import Simulation
from .spheres import REACH, SKIN, STIFFNESS, H, rows


def simulation(problem: Problem, threads: int | None = 1) -> Simulation:
    """Return LAMMPS with the spheres at their start.

    Of its styles with this force, gran/hertz/history is the fastest, although it keeps a history of the friction.
    """
    places = rows(problem.u0)
    low, high = places.min() - REACH, places.max() + REACH
    normal = STIFFNESS * 2 / REACH**0.5  # the force has the factor sqrt(radius / 2)
    before = f"""units si
atom_style sphere
atom_modify map array
boundary s s s
comm_modify vel yes
region box block {low:.17g} {high:.17g} {low:.17g} {high:.17g} {low:.17g} {high:.17g}
create_box 1 box
pair_style gran/hertz/history {normal:.17g} 0.0 0.0 0.0 0.0 0
pair_coeff * *
neighbor {SKIN} bin
neigh_modify every 1 delay 0 check yes
timestep {H}
thermo 1000000000"""
    after = f"""set group all diameter {REACH}
set group all mass 1.0
fix motion all nve"""
    return Simulation(before, after, places, rows(problem.v0), threads)
