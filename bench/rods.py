"""Chains of rigid rods at equal error: constraints, stiff springs, exudyn and MuJoCo."""

from __future__ import annotations

from functools import partial

import numpy as np

from eig3 import problems
from eig3.effects import Gravity, LinearSpring
from eig3.problem import Problem
from eig3.problems.rod_chain import G
from eig3.result.solution import Solution
from eig3.scene import Scene

from . import equal_error
from .equal_error import Run
from .rivals import exudyn, mujoco

ANGLE, T_END = 1.0, 0.5  # rad from the vertical, s
ERROR = 1e-4  # m, of a chain of 1 m
_STIFFNESS = 4e5  # N of a spring of the whole chain, which becomes 2e-5 m longer by its weight: in all a fifth of ERROR
_MOST_IN_MUJOCO = 100  # rods: its files do not take a thousand nested bodies
_NOTE = """Each method takes the fewest steps, among 50, 100, 200, ..., with which each mass ends within 0.1 mm of its
place; the error is in m. exudyn has point masses and constraints of their distances, and its implicit trapezoidal rule.
MuJoCo has no constraints here, because its own are soft: the joints of its chain are angles. Its RK4 evaluates four
times a step."""


def springs(n: int) -> Problem:
    """Return the chain of stiff springs in place of rods."""
    scene = Scene(dimension=2)
    way = np.array([np.sin(ANGLE), -np.cos(ANGLE)]) / n
    joints = scene.mass(1 / n, np.arange(1, n + 1)[:, None] * way)
    scene.add(LinearSpring(_STIFFNESS * n, 1 / n), scene.fixed((0.0, 0.0)), joints[0])
    scene.add(LinearSpring(_STIFFNESS * n, 1 / n), joints[:-1], joints[1:])
    scene.add(Gravity((0.0, -G)))
    return scene.problem((0.0, T_END), name="springs")


def run_of(problem: Problem, method: str) -> Run:
    """Return the run of a chain here, which saves its end only."""

    def run(steps: int) -> tuple[float, np.ndarray]:
        solution = problem.integrate(h=T_END / steps, t_end=T_END, method=method, save_every=None)
        return solution.kernel_seconds, places_of(solution)

    return run


def places_of(solution: Solution) -> np.ndarray:
    """Return the places of the masses at the end of a run."""
    return np.asarray(solution.u[-1]).reshape(2, -1).T


def runs(n: int) -> dict[str, Run]:
    """Return the contenders by name."""
    rods, stiff = problems.rod_chain(n, angle=ANGLE), springs(n)
    found = {f"rods, {name}": run_of(rods, method) for name, method in (("EIG-3", "eig3"), ("RK4", "rk4"))}
    found["springs, EIG-3"] = run_of(stiff, "eig3")
    if exudyn.is_there():
        found["exudyn"] = partial(exudyn.Chain(np.reshape(rods.u0, (2, -1)).T, 1 / n, 1 / n, G).run, T_END)
    if mujoco.is_there() and n <= _MOST_IN_MUJOCO:
        found["MuJoCo"] = partial(mujoco.Chain(n, 1 / n, 1 / n, ANGLE, G).run, T_END)
    return found


def table(sizes: tuple[int, ...], repeats: int) -> str:
    """Return the table for chains of these numbers of rods. Each run is repeated, and the runs take turns."""
    rows = [[str(n), *row] for n in sizes for row in rows_of(n, repeats)]
    return equal_error.page(["rods", *equal_error.HEADS], rows, _NOTE)


def rows_of(n: int, repeats: int) -> list[list[str]]:
    """Return the rows of the chains of n rods."""
    exact = places_of(problems.rod_chain(n, angle=ANGLE, t_end=T_END).integrate(rtol=1e-11, method="rk8"))

    def error_of(places: np.ndarray) -> float:
        return float(np.abs(places - exact).max())

    return equal_error.rows(runs(n), error_of, ERROR, repeats)
