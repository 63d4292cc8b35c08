"""The sum over waves in Ewald's sum: the energy of point charges and of all their periodic images, and the forces.

Of each pair of waves k and -k in the periodic box with the volume V, one has the energy A |S|^2 with S = sum of q exp(i
k x) over the points and A = 4 pi prefactor exp(-k^2 / (4 alpha^2)) / (V k^2), and exerts the force 2 A k q Im(conj(S)
exp(i k x)) on a point: P. P. Ewald, Annalen der Physik 369 (1921).

All numbers are in p, from the index `place` on: first the numbers below, then the forces, the waves and the turns.
"""

from __future__ import annotations

import numpy as np
from numba.types import float64, int64

from .compile.jit import element, of_library
from .elementary import sincos
from .neighbours import BATCH, batch, floats
from .protocol import vector_type

#: The numbers of points and of waves; where in p their positions and their charges begin; and for each axis the number
#: of the longest wave, rad/m, and its largest multiple.
POINTS, WAVES, X, CHARGES, LONGEST, MOST = 0, 1, 2, 3, 4, 7
FORCES = 10
#: The numbers of a wave: its multiples of the longest wave of each axis, A, and the parts of S.
_SIZE, _REAL, _IMAGINARY, _OF_WAVE = 3, 4, 5, 6


def block(
    x: int, charges: int, points: int, longest: np.ndarray, multiples: np.ndarray, sizes: np.ndarray
) -> np.ndarray:
    """Return the numbers of a sum over waves, with their `multiples`, one of each pair, and their A as `sizes`."""
    most = np.abs(multiples).max(axis=0)
    waves = np.zeros((len(multiples), _OF_WAVE))
    waves[:, :3], waves[:, _SIZE] = multiples, sizes
    head = [points, len(waves), x, charges, *longest, *most]
    turns = 2 * BATCH * int(np.sum(most + 1))
    return np.concatenate([head, np.zeros(3 * points), waves.ravel(), np.zeros(turns)])


@of_library(float64(vector_type, int64))
def sum_of_waves(p, place):
    """Return the energy of all waves, and write the forces on the points: x, y and z of each."""
    count, size = int64(p[place + POINTS]), _OF_WAVE * int64(p[place + WAVES])
    forces, table = floats(p, place + FORCES, 3 * count), floats(p, place + FORCES + 3 * count, size)
    turns = place + FORCES + 3 * count + size
    ones, others, energy = batch(), batch(), 0.0
    for j in range(3 * count):
        forces[j] = 0.0  # the first wave sets them, but 0 times a NaN of an earlier state would be NaN
    for k in range(0, size, _OF_WAVE):
        table[k + _REAL] = table[k + _IMAGINARY] = 0.0
    for begin in range(0, count, BATCH):
        some = _turn(p, place, turns, begin)
        for k in range(0, size, _OF_WAVE):
            wave = floats(table, k, _OF_WAVE)
            _on_points(p, place, turns, wave, some, ones, others)
            wave[_REAL] += _sum_of(ones, some)
            wave[_IMAGINARY] += _sum_of(others, some)
    for begin in range(0, count, BATCH):
        some = _turn(p, place, turns, begin)
        for k in range(0, size, _OF_WAVE):
            wave = floats(table, k, _OF_WAVE)
            _on_points(p, place, turns, wave, some, ones, others)
            _pull(p, place, wave, floats(forces, 3 * begin, 3 * some), k == 0, ones, others)
    for k in range(0, size, _OF_WAVE):
        energy += table[k + _SIZE] * (table[k + _REAL] ** 2 + table[k + _IMAGINARY] ** 2)
    return energy


@element
def _turn(p, place, turns, begin):
    """Write cos and sin of the multiples of the longest waves at some points; along x times the charges."""
    some = min(BATCH, int64(p[place + POINTS]) - begin)
    x = floats(p, int64(p[place + X]) + 3 * begin, 3 * some)
    q = floats(p, int64(p[place + CHARGES]) + begin, some)
    for axis in range(3):
        count = int64(p[place + MOST + axis]) + 1
        rows = floats(p, turns, 2 * BATCH * count)
        for e in range(some):
            sine, cosine = sincos(p[place + LONGEST + axis] * x[3 * e + axis])
            re, im = q[e] if axis == 0 else 1.0, 0.0
            for n in range(count):
                rows[2 * BATCH * n + e], rows[2 * BATCH * n + BATCH + e] = re, im
                re, im = re * cosine - im * sine, im * cosine + re * sine
        turns += 2 * BATCH * count
    return some


@element
def _on_points(p, place, turns, w, some, ones, others):
    """Write the parts of q exp(i k x) at some points for a wave."""
    rows = turns
    xs = floats(p, rows + 2 * BATCH * int64(w[0]), 2 * BATCH)
    rows += 2 * BATCH * (int64(p[place + MOST]) + 1)
    ys = floats(p, rows + 2 * BATCH * int64(abs(w[1])), 2 * BATCH)
    rows += 2 * BATCH * (int64(p[place + MOST + 1]) + 1)
    zs = floats(p, rows + 2 * BATCH * int64(abs(w[2])), 2 * BATCH)
    sign_y, sign_z = np.sign(w[1]), np.sign(w[2])
    for e in range(some):
        sy, sz = sign_y * ys[BATCH + e], sign_z * zs[BATCH + e]
        re, im = xs[e] * ys[e] - xs[BATCH + e] * sy, xs[BATCH + e] * ys[e] + xs[e] * sy
        ones[e], others[e] = re * zs[e] - im * sz, im * zs[e] + re * sz
    for e in range(some, -(-some // 4) * 4):
        ones[e] = others[e] = 0.0


@element
def _pull(p, place, wave, forces, is_first, ones, others):
    """Add the forces of a wave on some points; the first wave sets them."""
    kx, ky, kz = (wave[0] * p[place + LONGEST], wave[1] * p[place + LONGEST + 1], wave[2] * p[place + LONGEST + 2])
    re, im, before = 2 * wave[_SIZE] * wave[_REAL], 2 * wave[_SIZE] * wave[_IMAGINARY], 0.0 if is_first else 1.0
    for e in range(len(forces) // 3):
        pull = re * others[e] - im * ones[e]
        forces[3 * e] = before * forces[3 * e] + kx * pull
        forces[3 * e + 1] = before * forces[3 * e + 1] + ky * pull
        forces[3 * e + 2] = before * forces[3 * e + 2] + kz * pull


@element
def _sum_of(values, some):
    """Return a sum, in four parts: the compiler does not change the order of a sum."""
    a = b = c = d = 0.0
    for e in range(0, some, 4):
        a, b, c, d = a + values[e], b + values[e + 1], c + values[e + 2], d + values[e + 3]
    return (a + b) + (c + d)
