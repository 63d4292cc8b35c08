"""Solvers of rebound for bodies that attract each other: IAS15, and the symplectic map WHFast.

rebound has no dense output: its runs stop at each of the times. WHFast has fixed steps, of which some end there, and a
corrector of order 17.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from eig3.problem import Problem

from .rival import Answer

#: The dimension of each problem of bodies; its parameters are their G m.
DIMENSIONS = {"figure_eight": 2, "outer_solar_system": 3}
#: The problems in which the first body has nearly all mass, as WHFast needs it.
ORBITS = ["outer_solar_system"]


def ias15(problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    def run(tolerance: float) -> Answer:
        bodies = _simulation(problem, times[0])
        bodies.integrator = "ias15"
        bodies.integrator.epsilon = tolerance
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of steps that do not converge with the largest tolerances
            return _recorded(problem, times, bodies, bodies.integrate)

    return lambda tolerance: partial(run, tolerance)


def whfast(problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    def run(h: float) -> Answer:
        bodies = _simulation(problem, times[0])
        bodies.integrator = "whfast"
        bodies.integrator.safe_mode = 0
        bodies.integrator.corrector = 17
        bodies.dt = h
        substeps = round((times[1] - times[0]) / h)

        def advance(t: float) -> None:
            if t > times[0]:
                bodies.steps(substeps)
                bodies.synchronize()

        return _recorded(problem, times, bodies, advance)

    return lambda h: partial(run, h)


def _simulation(problem: Problem, t: float) -> Any:
    import rebound

    bodies = rebound.Simulation()
    bodies.t = t
    places, velocities = (np.zeros((len(np.ravel(problem.params)), 3)) for _ in range(2))
    for rows, values in ((places, problem.u0), (velocities, problem.v0)):
        rows[:, : DIMENSIONS[problem.name]] = np.reshape(values, (len(rows), -1))
    for mass, (x, y, z), (vx, vy, vz) in zip(np.ravel(problem.params), places, velocities, strict=True):
        bodies.add(m=mass, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
    return bodies


def _recorded(problem: Problem, times: np.ndarray, bodies: Any, advance: Callable[[float], None]) -> Answer:
    """Advance from each of the times to the next, and keep the states."""
    u, v = np.empty((2, len(times), bodies.N, 3))
    begin = time.perf_counter()
    for i, t in enumerate(times):
        advance(t)
        bodies.serialize_particle_data(xyz=u[i], vxvyvz=v[i])
    seconds = time.perf_counter() - begin
    flat = (rows[:, :, : DIMENSIONS[problem.name]].reshape(len(times), -1).T for rows in (u, v))
    return Answer.of(seconds, np.concatenate([*flat]), times, None, True)
