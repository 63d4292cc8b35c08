"""Chains of rigid rods at equal error: constraints, stiff springs, exudyn and MuJoCo."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eig3 import problems
from eig3.effects import Gravity, LinearSpring
from eig3.problem import Problem
from eig3.problems.rod_chain import G
from eig3.result.solution import Solution
from eig3.scene import Scene

from . import text
from .rivals import exudyn, mujoco

ANGLE, T_END = 1.0, 0.5  # rad from the vertical, s
ERROR = 1e-4  # m, of a chain of 1 m
_STIFFNESS = 4e5  # N of a spring of the whole chain, which becomes 2e-5 m longer by its weight: in all a fifth of ERROR
_FEWEST, _DOUBLINGS, _LONGEST = 50, 16, 30.0  # steps, and s of a run that is tried
_MOST_IN_MUJOCO = 100  # rods: its files do not take a thousand bodies, each in the one before
_NOTE = """Each method takes the fewest steps, among 50, 100, 200, ..., with which each mass ends within 0.1 mm of its
place. exudyn has point masses and constraints of their distances, and its implicit trapezoidal rule. MuJoCo has no
constraints here, because its own are soft: the joints of its chain are angles. Its RK4 evaluates four times a step."""

Run = Callable[[float, int], tuple[float, np.ndarray]]


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

    def run(t_end: float, steps: int) -> tuple[float, np.ndarray]:
        solution = problem.integrate(h=t_end / steps, t_end=t_end, method=method, save_every=None)
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
        found["exudyn"] = exudyn.Chain(np.reshape(rods.u0, (2, -1)).T, 1 / n, 1 / n, G).run
    if mujoco.is_there() and n <= _MOST_IN_MUJOCO:
        found["MuJoCo"] = mujoco.Chain(n, 1 / n, 1 / n, ANGLE, G).run
    return found


def fewest_steps(run: Run, exact: np.ndarray) -> tuple[int, float] | None:
    """Return the fewest steps with which a run has the error, and the error; None if it takes too long."""
    steps = _FEWEST
    for _ in range(_DOUBLINGS):
        seconds, places = run(T_END, steps)
        error = np.abs(places - exact).max()
        if error <= ERROR:
            return steps, error
        if 2 * seconds > _LONGEST:
            return None
        steps *= 2
    return None


def table(sizes: tuple[int, ...], repeats: int) -> str:
    """Return the table for chains of these numbers of rods. Each run is repeated, and the runs take turns."""
    heads = ["rods", "method", "steps", "error (m)", "ns a rod and step", "time / EIG-3"]
    rows = [row for n in sizes for row in rows_of(n, repeats)]
    missing = [rival.INSTALL for rival in (exudyn, mujoco) if not rival.is_there()]
    return "\n\n".join([text.table(heads, rows), _NOTE, *missing])


def rows_of(n: int, repeats: int) -> list[list[str]]:
    """Return the rows of the chains of n rods."""
    exact = places_of(problems.rod_chain(n, angle=ANGLE, t_end=T_END).integrate(rtol=1e-11, method="rk8"))
    contenders = runs(n)
    needed = {name: fewest_steps(run, exact) for name, run in contenders.items()}
    taken = {name: (*found, list[float]()) for name, found in needed.items() if found}
    for _ in range(repeats):
        for name, (steps, _, seconds) in taken.items():
            seconds.append(contenders[name](T_END, steps)[0])
    first = np.median(taken["rods, EIG-3"][2])
    rows = []
    for name in contenders:
        cells = ["-"] * 4
        if name in taken:
            steps, error, seconds = taken[name]
            middle = np.median(seconds)
            cells = [str(steps), f"{error:.1e}", f"{1e9 * middle / steps / n:.0f}", f"{middle / first:.2g}"]
        rows.append([str(n), name, *cells])
    return rows
