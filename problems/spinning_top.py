"""A spinning top: a heavy symmetric body that turns about a fixed point of its axis."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity
from eig3.problem import Problem
from eig3.scene import RigidBody, Scene

G = 9.81
MASS, HEIGHT = 0.5, 0.05  # kg; of the centre of mass along the axis, m
ACROSS, ALONG = 4e-4, 5e-4  # moments of inertia about the centre of mass, kg m^2
DISC = 0.05  # radius of the disc in the animation, m


def top(angular_velocity: float = 150.0, tilt: float = 0.5) -> tuple[Scene, RigidBody]:
    """Return the scene, and the top, whose axis is at rest at the start."""
    scene = Scene(dimension=3)
    c, s = np.cos(tilt), np.sin(tilt)
    turned = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    axis = turned[:, 2]
    body = scene.body(MASS, (ACROSS, ACROSS, ALONG), HEIGHT * axis, turned, angular_velocity=angular_velocity * axis)
    body.spherical(None, (0.0, 0.0, 0.0))
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    body.point(np.column_stack([DISC * np.cos(angles), DISC * np.sin(angles), np.zeros(8)]))
    body.point((0.0, 0.0, -HEIGHT))
    scene.add(Gravity((0.0, 0.0, -G)))
    return scene, body


def spinning_top(angular_velocity: float = 150.0, tilt: float = 0.5, t_end: float = 2.0) -> Problem:
    """Lagrange's top, whose axis is released at rest: it precesses and nutates.

    Parameters
    ----------
    angular_velocity : float
                Angular velocity about its axis, rad/s.
    tilt : float
                Angle between its axis and the vertical at the start, rad, above 0.
    t_end : float
        s.
    """
    scene, body = top(angular_velocity, tilt)
    return scene.problem((0.0, t_end), name="spinning_top").with_(
        h=5e-5,
        source="H. Goldstein, Classical Mechanics, section 5.7: the heavy symmetrical top with one point fixed",
        draw=partial(draw, body=body),
    )


def draw(figure, solution, body):
    x, y, z = body.centre.positions(solution.u).T / HEIGHT
    drawing.plane(figure, {"axis": (x, y)}, ("x (-)", "y (-)"), fixed="support")
    drawing.lines(drawing.time_panel(figure, "tilt of the axis\n(rad)"), solution.t, np.arccos(z))
    turned = np.unwrap(np.arctan2(x, -y))
    drawing.lines(drawing.time_panel(figure, "precession (rad)"), solution.t, turned)
