"""A chain of rods with masses at its joints."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import Gravity, Rod
from eig3.problem import Problem
from eig3.scene import Scene

G = 9.81


def rod_chain(n: int = 20, length: float = 1.0, mass: float = 1.0, angle: float = 1.0, t_end: float = 5.0) -> Problem:
    """A chain of rods that swings from rest, without friction; its motion is chaotic.

    Parameters
    ----------
    n : int
        Number of rods, and of masses.
    length, mass : float
        Of the whole chain, m and kg.
    angle : float
                Angle between the chain, which is straight at the start, and the vertical, rad.
    t_end : float
        s.
    """
    scene = Scene(dimension=2)
    way = length / n * np.array([np.sin(angle), -np.cos(angle)])
    joints = scene.mass(mass / n, np.arange(1, n + 1)[:, None] * way)
    scene.add(Rod(), scene.fixed((0.0, 0.0)), joints[0])
    scene.add(Rod(), joints[:-1], joints[1:])
    scene.add(Gravity((0.0, -G)))
    return scene.problem((0.0, t_end), name="rod_chain").with_(
        h=0.02 / n * np.sqrt(length),
        source="what the article leaves to future work: rigid rods",
        draw=partial(draw, joints=joints),
    )


def draw(figure, solution, joints):
    x = joints.positions(solution.u)
    drawing.plane(figure, {"path of the end": x[:, -1].T}, fixed="support")
    for k, name in enumerate("xy"):
        places = x[:, [len(joints) // 2, -1], k]
        drawing.lines(drawing.time_panel(figure, f"{name} (m)"), solution.t, places, ["middle", "end"])
