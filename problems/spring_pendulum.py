"""A point mass on a linear spring that swings in a plane: the accelerations depend on the velocities."""

import math

import numpy as np

from eig3 import drawing
from eig3.animation import Mechanism
from eig3.functions.callbacks import jit
from eig3.math import cos, sincos
from eig3.problem import Problem


@jit
def rhs(t, u, v, p, a):
    m, l0, k, g = p[0], p[1], p[2], p[3]
    r, theta = u[0], u[1]
    sine, cosine = sincos(theta)
    a[0] = r * v[1] * v[1] - k / m * (r - l0) + g * cosine
    a[1] = -(2 * v[0] * v[1] + g * sine) / r


@jit
def energy(t, u, v, p):
    m, l0, k, g = p[0], p[1], p[2], p[3]
    r, theta = u[0], u[1]
    kinetic = m / 2 * (v[0] * v[0] + r * r * v[1] * v[1])
    return kinetic + k / 2 * (r - l0) ** 2 - m * g * r * cos(theta)


def spring_pendulum(
    m: float = 1.0,
    l0: float = 0.5,
    k: float = 98.1,
    g: float = 9.81,
    r0: float = 0.75,
    theta0: float = math.pi / 2,
    t_end: float = 100.0,
) -> Problem:
    """The spring pendulum of the article, section 4.4, released from rest.

    u is (r, theta): the length of the spring in m and its angle from the vertical in rad.

    Parameters
    ----------
    m : float
        Mass, kg.
    l0 : float
        Natural length of the spring, m.
    k : float
        Stiffness, N/m.
    g : float
        Acceleration of gravity, m/s^2.
    r0, theta0 : float
        Length of the spring (m) and angle from the vertical (rad) at t = 0.
    t_end : float
        Duration, s.
    """
    return Problem(
        name="spring_pendulum",
        rhs=rhs,
        u0=(r0, theta0),
        v0=(0.0, 0.0),
        params=(m, l0, k, g),
        t_span=(0.0, t_end),
        energy=energy,
        units=("m", "rad"),
        source="EIG-3 article, section 4.4",
        h=1e-3,
        draw=draw,
        view=Mechanism(places, links=[(0, 1)], springs=[0], fixed=[0], trails=[1]),
    )


def places(t, u):
    """Return the places of the support and of the mass, m."""
    r, theta = u.T
    mass = np.stack([r * np.sin(theta), -r * np.cos(theta)], axis=-1)
    return np.stack([np.zeros_like(mass), mass], axis=1)


def draw(figure, solution):
    r, theta = solution.u.T
    drawing.plane(figure, {"path of the mass": (r * np.sin(theta), -r * np.cos(theta))}, fixed="support")
    drawing.lines(drawing.time_panel(figure, "length r (m)"), solution.t, r)
    drawing.lines(drawing.time_panel(figure, r"angle $\theta$ (rad)"), solution.t, theta)
