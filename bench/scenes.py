"""`eig3 bench scenes`: what the compiled code of a scene costs beside the same system written by hand."""

import math

import numpy as np

import eig3
from eig3.effects import Gravity, LinearDamper, LinearSpring
from eig3.problem import Problem
from eig3.scene import Scene


@eig3.jit
def pendulum_by_hand(t, u, v, p, a):
    k, length, m, g = p[0], p[1], p[2], p[3]
    r = math.sqrt(u[0] * u[0] + u[1] * u[1])
    pull = k * (r - length) / (r * m)
    a[0] = -pull * u[0]
    a[1] = -pull * u[1] - g


@eig3.jit
def rod_by_hand(t, u, v, p, a):
    k, length, w, start, end = p[0], p[1], p[2], p[3], p[4]
    n = u.size
    before = k * (u[0] - start - length)
    for j in range(n - 1):
        after = k * (u[j + 1] - u[j] - length)
        a[j] = (after - before) * w
        before = after
    a[n - 1] = (k * (end - u[n - 1] - length) - before) * w


@eig3.jit
def net_by_hand(t, u, v, p, a):
    """A row in space: springs alone."""
    k, length, w = p[0], p[1], p[2]
    n = 200
    bx = by = bz = 0.0
    for i in range(n - 1):
        dx, dy, dz = u[i + 1] - u[i], u[n + i + 1] - u[n + i], u[2 * n + i + 1] - u[2 * n + i]
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        pull = k * (r - length) / r * w
        fx, fy, fz = pull * dx, pull * dy, pull * dz
        a[i], a[n + i], a[2 * n + i] = fx - bx, fy - by, fz - bz
        bx, by, bz = fx, fy, fz
    a[n - 1], a[2 * n - 1], a[3 * n - 1] = -bx, -by, -bz


@eig3.jit
def rope_by_hand(t, u, v, p, a):
    k, length, c, w, g = p[0], p[1], p[2], p[3], p[4]
    n = 2000
    bx = by = bz = 0.0
    for i in range(n - 1):
        dx, dy, dz = u[i + 1] - u[i], u[n + i + 1] - u[n + i], u[2 * n + i + 1] - u[2 * n + i]
        ex, ey, ez = v[i + 1] - v[i], v[n + i + 1] - v[n + i], v[2 * n + i + 1] - v[2 * n + i]
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        pull = (k * (r - length) + c * (dx * ex + dy * ey + dz * ez) / r) / r * w
        fx, fy, fz = pull * dx, pull * dy, pull * dz
        a[i], a[n + i], a[2 * n + i] = fx - bx, fy - by, fz - bz - g
        bx, by, bz = fx, fy, fz
    a[n - 1], a[2 * n - 1], a[3 * n - 1] = -bx, -by, -bz - g
