"""A slider crank: a crank with a flywheel, a connecting rod and a piston on a straight line."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import PointJoint, Slider, Torque
from eig3.problem import Problem
from eig3.scene import Points, RigidBody, Scene

CRANK, ROD = 0.05, 0.16  # lengths, m
FLYWHEEL = 0.004  # moment of inertia of the crank about its bearing, kg m^2
CRANK_MASS, ROD_MASS, PISTON = 2.0, 0.8, 0.6  # kg; the centre of mass of the crank is in its bearing


def engine(angular_velocity: float = 50.0, torque: float = 0.0) -> tuple[Scene, RigidBody, RigidBody, Points]:
    """Return the scene, and its crank, rod and piston, at the start with the crank upright."""
    scene = Scene(dimension=2)
    pin, end = np.array([0.0, CRANK]), np.array([np.sqrt(ROD**2 - CRANK**2), 0.0])
    speed = np.array([-angular_velocity * CRANK, 0.0])  # of the rod, which does not turn in this position
    crank = scene.body(CRANK_MASS, FLYWHEEL, (0.0, 0.0), np.pi / 2, angular_velocity=angular_velocity)
    angle = np.arctan2(*(end - pin)[::-1])
    rod = scene.body(ROD_MASS, ROD_MASS * ROD**2 / 12, (pin + end) / 2, angle, velocity=speed)
    piston = scene.mass(PISTON, end, speed)
    crank.revolute(None, (0.0, 0.0))
    crank.revolute(rod, pin)
    scene.add(PointJoint(), rod.at(end), piston)
    scene.add(Slider(direction=(1.0, 0.0)), piston)
    if torque:
        scene.add(Torque(torque), crank.axes)
    return scene, crank, rod, piston


def slider_crank(angular_velocity: float = 50.0, torque: float = 0.0, t_end: float = 0.5) -> Problem:
    """A crank that turns a flywheel and moves a piston, without gravity and friction.

    Parameters
    ----------
    angular_velocity : float
                Angular velocity of the crank at the start, rad/s.
    torque : float
        On the crank, N m; without it, the energy is constant.
    t_end : float
        s.
    """
    scene, *parts = engine(angular_velocity, torque)
    return scene.problem((0.0, t_end), name="slider_crank").with_(
        h=1e-4,
        source="the kinetic energy is a function of the angle and the speed of the crank",
        draw=partial(draw, parts=parts),
    )


def draw(figure, solution, parts):
    crank, rod, piston = parts
    paths = {"middle of the rod": rod.centre.positions(solution.u).T, "piston": piston.positions(solution.u).T}
    drawing.plane(figure, paths, fixed="bearing")
    drawing.lines(
        drawing.time_panel(figure, "angular velocity of\nthe crank (rad/s)"),
        solution.t,
        crank.angular_velocity(solution.u, solution.v),
    )
    drawing.lines(drawing.time_panel(figure, "x of the\npiston (m)"), solution.t, piston.positions(solution.u)[:, 0])
