"""A four-bar linkage in the plane: a motor turns the crank, and the rocker swings with a load."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, LinearDamper, Torque
from eig3.problem import Problem
from eig3.scene import RigidBody, Scene

CRANK, COUPLER, ROCKER = np.array([0.1, 0.35, 0.25])  # lengths, m
BASE = 0.4  # m
LINE_DENSITY = 2.0  # kg/m


def linkage(torque: float = 1.5, damping: float = 20.0) -> tuple[Scene, list[RigidBody]]:
    """Return the scene, and its crank, coupler and rocker."""
    scene = Scene(dimension=2)
    start, end = np.zeros(2), np.array([BASE, 0.0])
    elbow = np.array([0.0, CRANK])
    way = end - elbow
    reach = np.linalg.norm(way)
    along = (COUPLER**2 - ROCKER**2 + reach**2) / (2 * reach)
    height = np.sqrt(COUPLER**2 - along**2)
    knee = elbow + (along * way + height * np.array([-way[1], way[0]])) / reach
    bars = []
    for first, second in ((start, elbow), (elbow, knee), (end, knee)):
        length, angle = float(np.linalg.norm(second - first)), np.arctan2(*(second - first)[::-1])
        mass = LINE_DENSITY * length
        bars.append(scene.body(mass, mass * length**2 / 12, (first + second) / 2, angle))
    crank, coupler, rocker = bars
    crank.revolute(None, start)
    crank.revolute(coupler, elbow)
    coupler.revolute(rocker, knee)
    rocker.revolute(None, end)
    scene.add(Gravity((0.0, -9.81)))
    scene.add(Torque(torque), crank.axes)
    scene.add(LinearDamper(damping), rocker.at(knee), scene.fixed((BASE + 0.3, 0.25)))
    return scene, bars


def four_bar(torque: float = 1.5, damping: float = 20.0, t_end: float = 5.0) -> Problem:
    """A crank and rocker with a motor and a damper.

    Parameters
    ----------
    torque : float
        Of the motor, N m.
    damping : float
        N s/m.
    t_end : float
        s.
    """
    scene, bars = linkage(torque, damping)
    return scene.problem((0.0, t_end), name="four_bar").with_(
        h=5e-4,
        source="a crank-rocker after Grashof's condition",
        draw=partial(draw, bars=bars),
    )


def draw(figure, solution, bars):
    names = ["crank", "coupler", "rocker"]
    plane = drawing.picture(figure, aspect="equal")
    for k, (name, bar) in enumerate(zip(names, bars, strict=True)):
        drawing.path(plane, *bar.centre.positions(solution.u).T, f"C{k}", f"middle of the {name}")
    plane.plot([0, BASE], [0, 0], "k^", label="ground")
    plane.set(xlabel="x (m)", ylabel="y (m)")
    drawing.legend(plane)
    rates = np.column_stack([bar.angular_velocity(solution.u, solution.v) for bar in bars])
    drawing.lines(drawing.time_panel(figure, "angular velocity\n(rad/s)"), solution.t, rates, names)
    swing = np.unwrap(bars[2].rotation(solution.u))
    drawing.lines(drawing.time_panel(figure, "angle of the rocker\n(rad)"), solution.t, swing)
