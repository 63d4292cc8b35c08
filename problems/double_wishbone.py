"""A quarter of a vehicle on a double wishbone: two arms, an upright, a tie rod, a spring and a damper."""

from dataclasses import dataclass
from functools import partial

import numpy as np

import eig3
from eig3 import drawing
from eig3.effects import Body, Gravity, LinearDamper, LinearSpring, Rod
from eig3.problem import Problem
from eig3.scene import RigidBody, Scene

G = 9.81
LOWER, UPPER = np.array([(0.0, 0.40, 0.25), (0.0, 0.45, 0.48)])  # inner hinges, along x, m: y is outwards, z is up
LOWER_BALL, UPPER_BALL = np.array([(0.0, 0.76, 0.22), (0.0, 0.71, 0.46)])  # outer joints
WHEEL, RADIUS = np.array([0.0, 0.82, 0.31]), 0.31  # its centre, and the radius of the tyre under its load, m
CHASSIS, MOUNT = np.array([(0.0, 0.20, 0.50), (0.0, 0.50, 0.62)])  # the centre of mass, and the top of the spring
LEVER = 0.6  # where the spring holds the lower arm, relative to the length of the arm
TIE = np.array([0.15, 0.0, 0.0])  # the tie rod is in front of the lower arm
MASSES = {"chassis": 350.0, "lower": 5.0, "upper": 3.0, "upright": 35.0}  # kg
PRELOAD = 6205.6  # of the spring, N, with which the car is at rest on a level road
TYRE, TYRE_DAMPING = 2e5, 300.0  # N/m, N s/m
BUMP = 0.04, 0.5, 0.1  # height, m; when the wheel meets it and how long it takes, s


@eig3.jit
def road(t):
    """The height of the road below the wheel, m."""
    height, start, duration = BUMP
    s = (t - start) / duration
    return 0.5 * height * (1 - np.cos(2 * np.pi * s)) if 0 < s < 1 else 0.0


@eig3.jit
def road_rate(t):
    height, start, duration = BUMP
    s = (t - start) / duration
    return np.pi * height / duration * np.sin(2 * np.pi * s) if 0 < s < 1 else 0.0


@dataclass(frozen=True, eq=False)
class Tyre(Body):
    """The force of the road on the centre of the wheel, which never pulls."""

    stiffness: float
    damping: float
    radius: float  # without a load, m

    @staticmethod
    @eig3.jit
    def force(t, x, v, stiffness, damping, radius):
        pressed = radius + road(t) - x[2]
        push = stiffness * pressed + damping * (road_rate(t) - v[2])
        return 0.0, 0.0, max(0.0, push) if pressed > 0 else 0.0


def suspension(spring: float = 60e3, damper: float = 4e3, tie: float = 0.01) -> tuple[Scene, dict[str, RigidBody]]:
    """Return the scene, and its bodies: the chassis, which moves up and down, both arms and the upright."""
    scene = Scene(dimension=3)
    ends = {"lower": (LOWER, LOWER_BALL), "upper": (UPPER, UPPER_BALL), "upright": (LOWER_BALL, UPPER_BALL)}
    bodies = {"chassis": scene.body(MASSES["chassis"], (50.0, 60.0, 70.0), CHASSIS)}
    for name, (first, second) in ends.items():
        length = float(np.linalg.norm(second - first))
        inertia = MASSES[name] * length**2 * np.array([0.10, 0.08, 0.09])
        bodies[name] = scene.body(MASSES[name], inertia, WHEEL if name == "upright" else (first + second) / 2)
    chassis, lower, upper, upright = bodies.values()
    along = 1.0, 0.0, 0.0
    chassis.prismatic(None, CHASSIS, (0.0, 0.0, 1.0))
    lower.revolute(chassis, LOWER, along)
    upper.revolute(chassis, UPPER, along)
    lower.spherical(upright, LOWER_BALL)
    upper.spherical(upright, UPPER_BALL)
    scene.add(Rod(), chassis.at(LOWER + TIE + (0.0, 0.0, tie)), upright.at(LOWER_BALL + TIE))
    foot = LOWER + LEVER * (LOWER_BALL - LOWER)
    strut = chassis.at(MOUNT), lower.at(foot)
    scene.add(LinearSpring(spring, float(np.linalg.norm(MOUNT - foot)) + PRELOAD / spring), *strut)
    scene.add(LinearDamper(damper), *strut)
    scene.add(Tyre(TYRE, TYRE_DAMPING, RADIUS + G * sum(MASSES.values()) / TYRE), upright.at(WHEEL))
    scene.add(Gravity((0.0, 0.0, -G)))
    return scene, bodies


def double_wishbone(spring: float = 60e3, damper: float = 4e3, tie: float = 0.01, t_end: float = 1.5) -> Problem:
    """A quarter of a vehicle that drives over a bump of 40 mm in 0.1 s.

    Parameters
    ----------
    spring : float
        Stiffness, N/m.
    damper : float
        N s/m.
    tie : float
        The height of the inner end of the tie rod above the hinge of the lower arm, m: at 0 the wheel does not steer.
    t_end : float
        s.
    """
    scene, bodies = suspension(spring, damper, tie)
    return scene.problem((0.0, t_end), name="double_wishbone").with_(
        h=2e-4,
        source="the double wishbone of vehicle dynamics",
        draw=partial(draw, bodies=bodies),
    )


def draw(figure, solution, bodies):
    t, wheel = solution.t, bodies["upright"].centre.positions(solution.u)
    body = bodies["chassis"].centre.positions(solution.u)[:, 2]
    heights = 1e3 * np.column_stack([wheel[:, 2] - wheel[0, 2], body - body[0], [road(x) for x in t]])
    drawing.lines(drawing.time_panel(figure, "height (mm)"), t, heights, ["wheel", "chassis", "road"])
    angles = np.rad2deg(np.column_stack(wheel_angles(bodies, solution.u)))
    drawing.lines(drawing.time_panel(figure, "angle of the\nwheel (degrees)"), t, angles, ["camber", "toe"])


def wheel_angles(bodies, u):
    """Return the camber, positive where the top leans outwards, and the toe-out of the wheel, rad."""
    axle = bodies["upright"].axes.positions(u)[:, 1]
    return -np.arcsin(axle[:, 2]), -np.arctan2(axle[:, 0], axle[:, 1])
