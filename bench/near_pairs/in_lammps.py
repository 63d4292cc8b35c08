"""The points of a scene in LAMMPS: spheres with Hertz's contact, without friction and damping, and argon."""

from __future__ import annotations

from eig3.problem import Problem

from ..rivals.lammps import Simulation
from . import atoms
from .spheres import REACH, SKIN, STIFFNESS, H, rows


def spheres(problem: Problem, threads: int | None = 1) -> Simulation:
    """Return LAMMPS with the spheres at their start.

    Of its styles with this force, gran/hertz/history is the fastest, although it keeps a history of the friction.
    """
    places = rows(problem.u0)
    normal = STIFFNESS * 2 / REACH**0.5  # the force has the factor sqrt(radius / 2)
    before = f"""units si
atom_style sphere
boundary s s s
comm_modify vel yes
{_box(places.min() - REACH, places.max() + REACH)}
pair_style gran/hertz/history {normal:.17g} 0.0 0.0 0.0 0.0 0
pair_coeff * *
{_steps(SKIN, H)}"""
    after = f"""set group all diameter {REACH}
set group all mass 1.0
fix motion all nve"""
    return Simulation(before, after, places, rows(problem.v0), threads)


def argon(problem: Problem, threads: int | None = 1) -> Simulation:
    """Return LAMMPS with the atoms at their start, and the same shifted force."""
    reduced = atoms.Reduced.of(problem)
    before = f"""units lj
atom_style atomic
boundary p p p
{_box(0, reduced.side)}
mass 1 1.0
pair_style lj/smooth/linear {atoms.REACH}
pair_coeff 1 1 1.0 1.0
{_steps(atoms.SKIN, reduced.h)}"""
    return Simulation(before, "fix motion all nve", reduced.places, reduced.speeds, threads)


def _box(low: float, high: float) -> str:
    edges = " ".join([f"{low:.17g} {high:.17g}"] * 3)
    return f"atom_modify map array\nregion box block {edges}\ncreate_box 1 box"


def _steps(skin: float, h: float) -> str:
    return f"neighbor {skin} bin\nneigh_modify every 1 delay 0 check yes\ntimestep {h:.17g}\nthermo 1000000000"
