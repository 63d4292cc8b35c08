"""Whole runs of argon and of the hopper as users start them: with energies and with states in files."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from eig3.problem import Problem
from eig3.problems.hopper import DIAMETER, FLOOR, MASS, OPENING, RESTITUTION, E, G, funnel, hopper
from eig3.problems.hopper import NU as POISSON

from .. import text
from ..rivals.lammps import Simulation
from ..timing import medians, seconds_of
from . import in_lammps
from .atoms import liquid

STEPS = 1000
EVERY = {"argon": 10, "hopper": 50}  # steps between states
_FRICTION = 0.5  # of `hopper`
_CONTACT = (
    f"hertz/material {E} {RESTITUTION} {POISSON} tangential mindlin_rescale/force NULL 1.0 {_FRICTION} "
    "damping coeff_restitution limit_damping"
)


def table(side: int, grains: int, repeats: int) -> str:
    """Return a table of the seconds of whole runs of 4 side^3 atoms and of grains: medians of interleaved runs."""
    lines = []
    for problem, start in (liquid(side), in_lammps.argon), (hopper(grains), grains_in_lammps):
        name = problem.name
        runs = {"scene": partial(scene_run, problem, STEPS), "LAMMPS": partial(lammps_run, start, problem, STEPS)}
        seconds = medians(runs, repeats, name)
        ratio = text.ratio(seconds["scene"] / seconds["LAMMPS"])
        lines.append([f"{name}, a state each {EVERY[name]} steps", *map(text.number, seconds.values()), ratio])
    return text.table([f"s of {STEPS} steps", "scene", "LAMMPS", "scene / LAMMPS"], lines)


def scene_run(problem: Problem, steps: int) -> float:
    """Return the seconds of `Problem.integrate`, which follows the energy of argon and writes the states to a file."""
    h, every = cast(float, problem.h), EVERY[problem.name]
    with tempfile.TemporaryDirectory() as folder:
        run = partial(problem.integrate, h=h, t_end=steps * h, save_every=every, save_to=folder)
        return seconds_of(run)


def lammps_run(start: Callable[[Problem], Simulation], problem: Problem, steps: int) -> float:
    """Return the seconds of the command `run`, with a line of energies and a binary dump of the states."""
    solver, every = start(problem).solver, EVERY[problem.name]
    with tempfile.TemporaryDirectory() as folder:
        solver.command(f"thermo {every}")
        solver.command(f"dump states all custom {every} {Path(folder) / 'states.bin'} id x y z vx vy vz")
        seconds = seconds_of(partial(solver.command, f"run {steps}"))
        solver.close()
    return seconds


def grains_in_lammps(problem: Problem) -> Simulation:
    """Return LAMMPS with the grains of `hopper` in a plane at their start."""
    n = problem.u0.size // 3
    places = np.concatenate([problem.u0.reshape(3, n)[:2].T, funnel(n, OPENING)])
    low, high = places.min() - (FLOOR + 2) * DIAMETER, places.max() + 2 * DIAMETER
    before = f"""units si
dimension 2
atom_style sphere
boundary s s p
newton off
comm_modify vel yes
atom_modify map array
region box block {low} {high} {low} {high} {-DIAMETER} {DIAMETER}
create_box 1 box
pair_style granular
pair_coeff * * {_CONTACT}
neighbor {DIAMETER / 5} bin
neigh_modify every 1 delay 0 check yes
timestep {problem.h}"""
    after = f"""set group all diameter {DIAMETER}
set group all mass {MASS}
group grains id <= {n}
group walls id > {n}
neigh_modify exclude group walls walls
fix weight grains gravity {G} vector 0 -1 0
fix motion grains nve/sphere disc
fix plane all enforce2d
fix floor grains wall/gran granular {_CONTACT} yplane {-FLOOR * DIAMETER} NULL"""
    in_space = np.column_stack([places, np.zeros(len(places))])
    simulation = Simulation(before, after, in_space, np.zeros_like(in_space))
    atom, view = simulation.solver.numpy.extract_atom, cast(Any, problem.view)
    atom("radius")[: len(places)] = view.radii[atom("id")[: len(places)] - 1]
    return simulation
