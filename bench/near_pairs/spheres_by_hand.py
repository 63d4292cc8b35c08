"""EIG-3 over spheres as a loop written by hand, with a list of the pairs that are near each other."""

from __future__ import annotations

import math
from collections.abc import Callable

import numba
import numpy as np

from eig3.kernels.compile.jit import OPTIONS
from eig3.problem import Problem

from .spheres import REACH, SKIN, STIFFNESS, H


def by_hand(problem: Problem) -> Callable[[int], np.ndarray]:
    """Return a loop of EIG-3 over spheres, which returns the displacements after some steps."""
    n = np.size(problem.u0) // 3
    u0, v0 = np.array(problem.u0), np.array(problem.v0)
    low = u0.reshape(3, n).min(axis=1) - 2.0
    dims = np.ceil((u0.reshape(3, n).max(axis=1) + 2.0 - low) / (REACH + SKIN)).astype(np.int64)
    march = numba.njit(**OPTIONS)(_march)
    lists = np.zeros(dims.prod() + 2, np.int32), *(np.empty(size, np.int32) for size in (n, n, n + 1, 40 * n))

    def run(steps: int) -> np.ndarray:
        u, v = u0.copy(), v0.copy()
        march(u, v, steps, n, low, dims, *lists)
        return u

    return run


@numba.njit(**OPTIONS)
def _listed(u, n, low, dims, start, order, cell, first, mates):
    nx, ny, nz = dims
    far = REACH + SKIN
    for c in range(nx * ny * nz + 1):
        start[c] = 0
    for i in range(n):
        x = min(nx - 1, max(0, int((u[i] - low[0]) / far)))
        y = min(ny - 1, max(0, int((u[n + i] - low[1]) / far)))
        z = min(nz - 1, max(0, int((u[2 * n + i] - low[2]) / far)))
        cell[i] = (z * ny + y) * nx + x
        start[cell[i] + 1] += 1
    for c in range(nx * ny * nz):
        start[c + 1] += start[c]
    for i in range(n - 1, -1, -1):
        start[cell[i] + 1] -= 1
        order[start[cell[i] + 1]] = i
    start[nx * ny * nz + 1] = n
    k = 0
    for i in range(n):
        first[i] = k
        c = cell[i]
        cx, cy, cz = c % nx, (c // nx) % ny, c // (nx * ny)
        for z in range(max(0, cz - 1), min(nz, cz + 2)):
            for y in range(max(0, cy - 1), min(ny, cy + 2)):
                row = (z * ny + y) * nx
                for q in range(start[row + max(0, cx - 1) + 1], start[row + min(nx, cx + 2) + 1]):
                    j = order[q]
                    if j > i:
                        dx, dy, dz = u[j] - u[i], u[n + j] - u[n + i], u[2 * n + j] - u[2 * n + i]
                        if dx * dx + dy * dy + dz * dz < far * far:
                            mates[k] = j
                            k += 1
    first[n] = k


@numba.njit(**OPTIONS)
def _forces(u, n, first, mates, a):
    for j in range(3 * n):
        a[j] = 0.0
    for i in range(n):
        x, y, z, fx, fy, fz = u[i], u[n + i], u[2 * n + i], 0.0, 0.0, 0.0
        for q in range(first[i], first[i + 1]):
            j = mates[q]
            dx, dy, dz = u[j] - x, u[n + j] - y, u[2 * n + j] - z
            square = dx * dx + dy * dy + dz * dz
            if square < REACH * REACH:
                r = math.sqrt(square)
                f = STIFFNESS * (REACH - r) * math.sqrt(REACH - r) / r
                fx, fy, fz = fx - f * dx, fy - f * dy, fz - f * dz
                a[j] += f * dx
                a[n + j] += f * dy
                a[2 * n + j] += f * dz
        a[i] += fx
        a[n + i] += fy
        a[2 * n + i] += fz


def _march(u, v, steps, n, low, dims, start, order, cell, first, mates):
    built, a, before = u.copy(), np.empty(3 * n), np.empty(3 * n)
    _listed(u, n, low, dims, start, order, cell, first, mates)
    _forces(u, n, first, mates, before)
    for _ in range(steps):
        worst = 0.0
        for i in range(n):
            x, y, z = u[i] - built[i], u[n + i] - built[n + i], u[2 * n + i] - built[2 * n + i]
            worst = max(worst, x * x + y * y + z * z)
        if 4 * worst > SKIN * SKIN:
            _listed(u, n, low, dims, start, order, cell, first, mates)
            for j in range(3 * n):
                built[j] = u[j]
        _forces(u, n, first, mates, a)
        for j in range(3 * n):
            u[j] += H * v[j] - H * H / 2 * before[j] + H * H * a[j]
            v[j] += 1.5 * H * a[j] - H / 2 * before[j]
            before[j] = a[j]
