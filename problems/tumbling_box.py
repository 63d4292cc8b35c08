"""A box in free flight that turns about its intermediate axis, and flips again and again."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.problem import Problem
from eig3.scene import RigidBody, Scene


def scene_of_box(
    sides: tuple[float, float, float] = (0.3, 0.2, 0.1),
    mass: float = 1.0,
    angular_velocity: float = 10.0,
    tilt: float = 1e-3,
) -> tuple[Scene, RigidBody]:
    """Return the scene, and the box."""
    scene = Scene(dimension=3)
    a, b, c = np.square(sides)
    inertia = mass / 12 * np.array([b + c, a + c, a + b])
    box = scene.body(mass, inertia, (0.0, 0.0, 0.0), angular_velocity=(tilt * angular_velocity, angular_velocity, 0.0))
    return scene, box


def tumbling_box(
    sides: tuple[float, float, float] = (0.3, 0.2, 0.1),
    mass: float = 1.0,
    angular_velocity: float = 10.0,
    tilt: float = 1e-3,
    t_end: float = 10.0,
) -> Problem:
    """A box in free flight, which flips about its intermediate axis.

    Parameters
    ----------
    sides : tuple of float
        Along x, y and z, m; the side along y is neither the longest nor the shortest.
    mass : float
        kg.
    angular_velocity : float
        Angular velocity about y at the start, rad/s.
    tilt : float
        The angular velocity about x at the start, divided by the angular velocity about y.
    t_end : float
        s.
    """
    scene, box = scene_of_box(sides, mass, angular_velocity, tilt)
    return scene.problem((0.0, t_end), name="tumbling_box").with_(
        h=1e-3,
        source="L. D. Landau and E. M. Lifshitz, Mechanics, section 37: Euler's equations of an asymmetrical top",
        draw=partial(draw, box=box),
    )


def draw(figure, solution, box):
    axes = box.axes.positions(solution.u)
    names = ["longest", "intermediate", "shortest"]
    up = drawing.time_panel(figure, "y of the axis (-)")
    drawing.lines(up, solution.t, axes[..., 1], names)
    spins = np.einsum("tka,ta->tk", axes, box.angular_velocity(solution.u, solution.v))
    drawing.lines(drawing.time_panel(figure, "angular velocity about\nthe axis (rad/s)"), solution.t, spins, names)
