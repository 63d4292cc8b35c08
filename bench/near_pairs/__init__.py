"""Scenes with lists of neighbours beside LAMMPS, OpenMM and exudyn."""

from __future__ import annotations

import os

import numpy as np

from eig3.problem import Problem

from ..rivals import exudyn, lammps, openmm
from ..timing import kernel_run
from . import in_lammps, in_openmm, whole_runs
from .atoms import liquid
from .contest import SCENE, Contest, Run, Who, table
from .spheres import REACH, STIFFNESS, H, linear, rows, spheres

_CORES = sorted({1, os.cpu_count() or 1})
_GRAINS = 5000  # of the hopper
_MOST_IN_EXUDYN = 10_000  # spheres: it takes a microsecond for each and step
_OF_AN_ATOM = 10  # the time of an atom with its neighbours, in units of the time of a sphere

Runs = dict[Who, Run]

_LAMMPS = """LAMMPS has the same skin as the scene, and checks at each step whether its list is still valid.
It takes its variants for OpenMP, which are not slower on one core.
Where a ratio is below 1, the scene is faster."""
_OPENMM = """OpenMM computes in single precision on its platform CPU, and in double precision on Reference.
Its NonbondedForce jumps at the cutoff. So the shifted force is given as a formula to its CustomNonbondedForce."""
_EXUDYN = """Contacts of exudyn between all spheres are linear; here the scene has linear contacts too.
exudyn has Euler's symplectic method, which is of order 1, and searches for the contacts at each step."""


def tables(sizes: tuple[int, ...], side: int, repeats: int) -> str:
    """Return the tables, for these numbers of spheres, and for 4 side^3 atoms."""
    parts = [
        "Spheres with Hertz's contact:",
        table("spheres", [hertz(n) for n in sizes], repeats),
        _LAMMPS if lammps.is_there() else lammps.INSTALL,
        "Spheres with a linear contact:",
        table("spheres", [linear_contacts(n) for n in sizes if n <= _MOST_IN_EXUDYN], repeats),
        _EXUDYN if exudyn.is_there() else exudyn.INSTALL,
        "Atoms of argon:",
        table("atoms", [argon(side)], repeats),
        _OPENMM if openmm.is_there() else openmm.INSTALL,
    ]
    if lammps.is_there():
        parts += ["Whole runs, with energies and with states in files:", whole_runs.table(side, _GRAINS, repeats)]
    return "\n\n".join(parts)


def hertz(n: int) -> Contest:
    """Return the contest of spheres with Hertz's contact."""
    problem = spheres(n)
    runs: Runs = {(SCENE, cores): scene_run(spheres(n, threads=cores), H) for cores in _CORES}
    if lammps.is_there():
        for cores in _CORES:
            runs["LAMMPS", cores] = in_lammps.spheres(problem, cores).run
    return Contest.of(n, runs)


def linear_contacts(n: int) -> Contest:
    """Return the contest of spheres with a linear contact."""
    problem = linear(n)
    start = rows(problem.u0), rows(problem.v0)
    runs: Runs = {(SCENE, cores): scene_run(linear(n, cores), H) for cores in _CORES}
    if exudyn.is_there():
        for cores in _CORES:
            runs["exudyn", cores] = exudyn.Simulation(*start, STIFFNESS, REACH, H, cores).run
    return Contest.of(n, runs)


def argon(side: int) -> Contest:
    """Return the contest of atoms of argon."""
    problem = liquid(side)
    runs: Runs = {(SCENE, cores): scene_run(liquid(side, cores), problem.h or H) for cores in _CORES}
    if lammps.is_there():
        for cores in _CORES:
            runs["LAMMPS", cores] = in_lammps.argon(problem, cores).run
    if openmm.is_there():
        runs["OpenMM, Reference", 1] = in_openmm.simulation(problem).run
        for jumps, kind in ((False, "single precision"), (True, "single precision, jumping force")):
            for cores in _CORES:
                runs[f"OpenMM, CPU, {kind}", cores] = in_openmm.simulation(problem, "CPU", cores, jumps=jumps).run
    return Contest.of(np.size(problem.u0) // 3, runs, cost=_OF_AN_ATOM)


def scene_run(problem: Problem, h: float) -> Run:
    """Return the run of a scene with EIG-3."""
    stepper = problem.stepper(h=h)
    return lambda steps: kernel_run(stepper, steps)()
