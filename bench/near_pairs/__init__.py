"""Scenes with lists of neighbours beside loops by hand with such lists, LAMMPS, OpenMM and exudyn."""

from __future__ import annotations

import os
from functools import partial

from eig3.problem import Problem
from eig3.stepping.team import alone

from ..rivals import exudyn, lammps, openmm
from ..timing import kernel_run, seconds_of
from . import atoms_in_lammps, atoms_in_openmm, spheres_in_lammps
from .atoms import liquid
from .contest import SCENE, Contest, Run, table
from .spheres import REACH, STIFFNESS, H, linear, rows, spheres
from .spheres_by_hand import by_hand

_CORES = os.cpu_count() or 1
_MOST_IN_EXUDYN = 10_000  # spheres: it takes a microsecond for each and step
_OF_AN_ATOM = 10  # the time of an atom with its neighbours, in those of a sphere

_LAMMPS = """LAMMPS has the skin of the scene, and looks at each step whether its list is still valid.
It takes its variants for OpenMP, which are not slower on one core.
The ratios are those of the scene on one core. Where a ratio is below 1, this is faster."""
_OPENMM = """OpenMM computes in single precision on its platform CPU, and in double precision on Reference.
Its own force of Lennard-Jones is not the one of the scene: it jumps at the reach. The shifted force is a formula."""
_EXUDYN = """Contacts of exudyn between all spheres are linear, and so are those of the scene here.
exudyn has Euler's symplectic method, which is of order 1, and looks for the contacts anew in each step."""


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
    return "\n\n".join(parts)


def hertz(n: int) -> Contest:
    """Return the contest of spheres with Hertz's contact."""
    problem = spheres(n)
    loop = by_hand(problem)
    runs = scene_runs(problem, H) | {"loop by hand, one core": lambda steps: seconds_of(partial(loop, steps))}
    if lammps.is_there():
        for threads, name in _threads("LAMMPS"):
            runs[name] = spheres_in_lammps.session(problem, threads).run
    return Contest.of(n, runs)


def linear_contacts(n: int) -> Contest:
    """Return the contest of spheres with a linear contact."""
    problem = linear(n)
    runs = scene_runs(problem, H)
    if exudyn.is_there():
        for threads, name in _threads("exudyn"):
            start = rows(problem.u0), rows(problem.v0)
            runs[name] = exudyn.Session(*start, STIFFNESS, REACH, H, threads).run
    return Contest.of(n, runs)


def argon(side: int) -> Contest:
    """Return the contest of atoms of argon."""
    problem = liquid(side)
    runs = scene_runs(problem, problem.h or H)
    if lammps.is_there():
        for threads, name in _threads("LAMMPS"):
            runs[name] = atoms_in_lammps.session(problem, threads).run
    if openmm.is_there():
        runs["OpenMM, Reference, one core"] = atoms_in_openmm.session(problem).run
        for jumps, kind in ((False, "single precision"), (True, "single precision, jumping force")):
            for threads, name in _threads(f"OpenMM, CPU, {kind}"):
                runs[name] = atoms_in_openmm.session(problem, "CPU", threads, jumps=jumps).run
    return Contest.of(problem.u0.size // 3, runs, cost=_OF_AN_ATOM)


def scene_runs(problem: Problem, h: float) -> dict[str, Run]:
    """Return the runs of a scene with EIG-3, on one core and on all."""
    stepper = problem.stepper(h=h)

    def on_one_core(steps: int) -> float:
        with alone():
            return kernel_run(stepper, steps)()

    runs: dict[str, Run] = {SCENE: on_one_core}
    if _CORES > 1 and stepper.system.shares:
        runs[f"scene, {_CORES} cores"] = lambda steps: kernel_run(stepper, steps)()
    return runs


def _threads(name: str) -> list[tuple[int, str]]:
    """Return the numbers of threads, with the name of each contestant."""
    found = [(1, f"{name}, one core")]
    return found + ([(_CORES, f"{name}, {_CORES} cores")] if _CORES > 1 else [])
