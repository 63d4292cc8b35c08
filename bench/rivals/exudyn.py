"""Spheres with linear contacts, chains of rods and planar linkages in exudyn. It needs `exudyn`."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from .rival import is_installed

INSTALL = "exudyn is not installed: `pip install exudyn`."
is_there = partial(is_installed, "exudyn")
_CELL = 2.5  # of the search for contacts, in diameters: the fastest of 1 to 2.5


class Simulation:
    """One exudyn with spheres of mass 1 that push each other apart in proportion to their indentation.

    Parameters
    ----------
    places, speeds : ndarray of shape (n, 3)
    stiffness : float
        Of a contact, N/m.
    diameter : float
    h : float
        The step of its symplectic Euler method, which evaluates the forces once a step.
    threads : int
    """

    def __init__(
        self, places: np.ndarray, speeds: np.ndarray, stiffness: float, diameter: float, h: float, threads: int
    ) -> None:
        import exudyn
        from exudyn import itemInterface

        self.h, self.threads = h, threads
        self._container = exudyn.SystemContainer()  # it owns the system
        self.system = self._container.AddSystem()
        contact = self.system.AddGeneralContact()
        for place, speed in zip(places.tolist(), speeds.tolist(), strict=True):
            point = itemInterface.NodePoint(referenceCoordinates=place, initialVelocities=speed)
            node = self.system.AddNode(point)
            self.system.AddObject(itemInterface.MassPoint(mass=1.0, nodeNumber=node))
            marker = self.system.AddMarker(itemInterface.MarkerNodePosition(nodeNumber=node))
            contact.AddSphereWithMarker(
                marker,
                radius=diameter / 2,
                contactStiffness=2 * stiffness,  # each sphere has a spring, and the two are in series
                contactDamping=0.0,
                frictionMaterialIndex=0,
            )
        contact.SetFrictionPairings(np.zeros((1, 1)))
        low, high = places.min(axis=0) - 2 * diameter, places.max(axis=0) + 2 * diameter
        cells = np.maximum(1, (high - low) / (_CELL * diameter)).astype(int)
        contact.SetSearchTreeCellSize(numberOfCells=cells.tolist())
        contact.SetSearchTreeBox(pMin=low, pMax=high)
        self.system.Assemble()

    def run(self, steps: int) -> float:
        """Return the seconds of these steps from the start."""
        import exudyn

        settings = self._settings(exudyn, steps)
        begin = time.perf_counter()
        self.system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.ExplicitEuler, updateInitialValues=False)
        return time.perf_counter() - begin

    def _settings(self, exudyn: Any, steps: int) -> Any:
        settings = exudyn.SimulationSettings()
        settings.parallel.numberOfThreads = self.threads
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse  # else the masses are a full matrix
        settings.solution.file.write = settings.solution.file.writeInitialValues = False
        times = settings.timeIntegration
        times.numberOfSteps, times.endTime = steps, steps * self.h
        times.automaticStepSize = times.adaptiveStep = False
        times.explicit.computeEndOfStepAccelerations = False
        times.explicit.computeMassMatrixInversePerBody = True
        times.explicit.eliminateConstraints = False
        times.explicit.useLieGroupIntegration = False
        return settings

    def speeds(self) -> np.ndarray:
        """Return the velocities after the last run, of shape (n, 3)."""
        return np.array(self.system.systemData.GetODE2Coordinates_t()).reshape(-1, 3)


class Chain:
    """Point masses in the plane, and rods between them that are constraints of their distance.

    Parameters
    ----------
    places : ndarray, shape (n, 2)
        Of the masses; the first rod begins at the origin.
    length, mass : float
        Of one rod, m, and of one mass, kg.
    gravity : float
    """

    def __init__(self, places: np.ndarray, length: float, mass: float, gravity: float) -> None:
        import exudyn
        from exudyn import itemInterface

        self._container = exudyn.SystemContainer()  # it owns the system
        self.system = self._container.AddSystem()
        ground = self.system.AddObject(itemInterface.ObjectGround())
        last = self.system.AddMarker(itemInterface.MarkerBodyPosition(bodyNumber=ground))
        self.nodes = []
        for place in places.tolist():
            node = self.system.AddNode(itemInterface.NodePoint2D(referenceCoordinates=place))
            self.system.AddObject(itemInterface.MassPoint2D(physicsMass=mass, nodeNumber=node))
            marker = self.system.AddMarker(itemInterface.MarkerNodePosition(nodeNumber=node))
            self.system.AddLoad(itemInterface.Force(markerNumber=marker, loadVector=[0, -mass * gravity, 0]))
            self.system.AddObject(itemInterface.ObjectConnectorDistance(markerNumbers=[last, marker], distance=length))
            self.nodes.append(node)
            last = marker
        self.system.Assemble()

    def run(self, t_end: float, steps: int) -> tuple[float, np.ndarray]:
        """Return the seconds of a run with the trapezoidal rule of index 2, and the places of the masses at its end."""
        import exudyn

        seconds = _trapezoidal(self.system, t_end, steps, exudyn.LinearSolverType.EigenSparse)
        found = [self.system.GetNodeOutput(node, exudyn.OutputVariableType.Position)[:2] for node in self.nodes]
        return seconds, np.array(found)


class Linkage:
    """Rigid bodies in the plane, joined by hinges, with a spring to the ground and a torque on the first body.

    Parameters
    ----------
    linkage : Linkage
    """

    def __init__(self, linkage: Any) -> None:
        import exudyn
        from exudyn import itemInterface

        self._linkage = linkage
        self._container = exudyn.SystemContainer()  # it owns the system
        self.system = self._container.AddSystem()
        self._ground = self.system.AddObject(itemInterface.ObjectGround())
        self._nodes, self._bodies = [], []
        for mass, inertia, centre, angle in linkage.bodies:
            node = self.system.AddNode(itemInterface.NodeRigidBody2D(referenceCoordinates=[*centre, angle]))
            body = itemInterface.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)
            self._nodes.append(node)
            self._bodies.append(self.system.AddObject(body))
        for first, second, place in linkage.joints:
            markers = [self._marker(first, place), self._marker(second, place)]
            self.system.AddObject(itemInterface.ObjectJointRevolute2D(markerNumbers=markers))
        base, body, hook, stiffness, length = linkage.spring
        markers = [self._marker(None, base), self._marker(body, hook)]
        spring = itemInterface.ObjectConnectorSpringDamper(
            markerNumbers=markers, stiffness=stiffness, referenceLength=length
        )
        self.system.AddObject(spring)
        marker = self.system.AddMarker(itemInterface.MarkerBodyRigid(bodyNumber=self._bodies[0]))
        self.system.AddLoad(itemInterface.LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, linkage.torque]))
        self.system.Assemble()

    def _marker(self, body: int | None, place: np.ndarray) -> Any:
        """Return a point of a body, or of the ground, at a place at the start."""
        from exudyn import itemInterface

        number, local = self._ground, np.asarray(place)
        if body is not None:
            _, _, centre, angle = self._linkage.bodies[body]
            c, s = np.cos(angle), np.sin(angle)
            number, local = self._bodies[body], np.array([[c, s], [-s, c]]) @ (local - centre)
        return self.system.AddMarker(itemInterface.MarkerBodyPosition(bodyNumber=number, localPosition=[*local, 0]))

    def run(self, t_end: float, steps: int) -> tuple[float, np.ndarray]:
        """Return the seconds of a run with the trapezoidal rule of index 2, and the angles of the bodies at its end."""
        import exudyn

        seconds = _trapezoidal(self.system, t_end, steps, exudyn.LinearSolverType.EXUdense)
        turned = [self.system.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates)[2] for node in self._nodes]
        return seconds, np.array([body[3] for body in self._linkage.bodies]) + turned


def _trapezoidal(system: Any, t_end: float, steps: int, solver: Any) -> float:
    """Return the seconds of a run with the trapezoidal rule of index 2, which leaves the system at its end."""
    import exudyn

    settings = exudyn.SimulationSettings()
    settings.linearSolver.solverType = solver
    settings.solution.file.write = settings.solution.file.writeInitialValues = False
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = steps, t_end
    settings.timeIntegration.newton.useModifiedNewton = True
    begin = time.perf_counter()
    kind = exudyn.DynamicSolverType.TrapezoidalIndex2
    system.SolveDynamic(settings, solverType=kind, updateInitialValues=False)
    return time.perf_counter() - begin
