"""Three equal bodies that follow each other on a path in the form of an eight, after Chenciner and Montgomery."""

import math

import numpy as np

from eig3 import drawing
from eig3.animation import Mechanism
from eig3.functions.callbacks import jit
from eig3.problem import Problem

PERIOD = 6.32591398292621  # after it, each body is where it was


@jit
def rhs(t, u, v, p, a):
    for i in range(p.size):
        x, y = u[2 * i], u[2 * i + 1]
        ax, ay = 0.0, 0.0
        for k in range(i):
            dx, dy = u[2 * k] - x, u[2 * k + 1] - y
            square = dx * dx + dy * dy
            pull = 1 / (square * math.sqrt(square))
            ax += p[k] * pull * dx
            ay += p[k] * pull * dy
            a[2 * k] -= p[i] * pull * dx
            a[2 * k + 1] -= p[i] * pull * dy
        a[2 * i], a[2 * i + 1] = ax, ay


@jit
def energy(t, u, v, p):
    total = 0.0
    for i in range(p.size):
        total += p[i] * (v[2 * i] * v[2 * i] + v[2 * i + 1] * v[2 * i + 1]) / 2
        for k in range(i):
            total -= p[i] * p[k] / math.hypot(u[2 * k] - u[2 * i], u[2 * k + 1] - u[2 * i + 1])
    return total


def figure_eight(t_end: float = 20 * PERIOD) -> Problem:
    """Three bodies of mass 1 in the plane, with G = 1; u has x and y of each body; all quantities are dimensionless.

    Parameters
    ----------
    t_end : float
        Duration; 20 periods if not given.

    Notes
    -----
    The initial state has eight digits. The motion is stable, and stays near the periodic orbit. The parameters are the
    three masses.
    """
    x, y, vx, vy = 0.97000436, -0.24308753, -0.93240737, -0.86473146
    return Problem(
        name="figure_eight",
        rhs=rhs,
        u0=np.array([x, y, -x, -y, 0.0, 0.0]),
        v0=np.array([-vx / 2, -vy / 2, -vx / 2, -vy / 2, vx, vy]),
        params=np.ones(3),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="-",
        units="-",
        names=("x1", "y1", "x2", "y2", "x3", "y3"),
        source="Chenciner and Montgomery, Annals of Mathematics 152 (2000), 881-901",
        h=1e-3,
        draw=draw,
        view=Mechanism(places, trails=range(3), labels=("x (-)", "y (-)")),
    )


def places(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the places of the bodies, shape (m, 3, 2)."""
    return u.reshape(len(u), -1, 2)


def draw(figure, solution):
    paths = {f"body {i + 1}": places(solution.t, solution.u)[:, i].T for i in range(3)}
    drawing.plane(figure, paths, ("x (-)", "y (-)"))
    drawing.histories(figure, solution, units=("-", "-"))
