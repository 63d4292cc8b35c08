"""OpenMM with points that act on each other. It needs `openmm`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from .rival import is_installed

INSTALL = "OpenMM is not installed: `pip install openmm`."
is_there = partial(is_installed, "openmm")


class Simulation:
    """One OpenMM with points in space, for numbers in any units that belong together.

    Parameters
    ----------
    forces : sequence
        The forces of OpenMM.
    places, speeds : ndarray of shape (n, 3)
    h : float
        The step of its integrator, Verlet's method.
    masses : ndarray of shape (n,), optional
        They are 1 without it.
    box : float or ndarray of shape (3,), optional
        The edge of a periodic cube, or the sides of a box.
    platform : str
        "Reference", or "CPU", which computes in single precision.
    threads : int
        Of the platform CPU.
    """

    def __init__(
        self,
        forces: Sequence[Any],
        places: np.ndarray,
        speeds: np.ndarray,
        h: float,
        *,
        masses: np.ndarray | None = None,
        box: float | np.ndarray | None = None,
        platform: str = "Reference",
        threads: int = 1,
    ) -> None:
        import openmm

        self.places, self.speeds = places, speeds
        system = openmm.System()
        if box is not None:
            system.setDefaultPeriodicBoxVectors(*(box * np.eye(3)))
        for mass in np.ones(len(places)) if masses is None else masses:
            system.addParticle(mass)
        for force in forces:
            system.addForce(force)
        self.integrator = openmm.VerletIntegrator(h)
        options = {"Threads": str(threads)} if platform == "CPU" else {}
        found = openmm.Platform.getPlatformByName(platform)
        self.context = openmm.Context(system, self.integrator, found, options)

    def run(self, steps: int) -> float:
        """Return the seconds of these steps from the start; the first step, which makes the list, is there before."""
        self.context.setPositions(self.places)
        self.context.setVelocities(self.speeds)
        self.integrator.step(1)
        begin = time.perf_counter()
        self.integrator.step(steps)
        return time.perf_counter() - begin

    def forces(self) -> np.ndarray:
        """Return the forces at the start, of shape (n, 3)."""
        self.context.setPositions(self.places)
        state = self.context.getState(getForces=True)
        return np.array(state.getForces(asNumpy=True)._value)  # without the unit
