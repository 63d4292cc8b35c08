"""Points that rigid bodies carry: their coordinates follow from a scene's coordinates, and their forces act on these.

A carried point is at the sum of the positions of some masses, times factors. A force on it is a force on these masses,
times the same factors. In the arrays of all points, carried points follow the masses, and have the mass 1; what follows
the coordinates stays behind them.
"""

from numba.types import Array, float64, int32, int64, none

from .compile.jit import of_library
from .protocol import index, vector_type

_floats, _integers = vector_type, Array(int32, 1, "C")


@of_library(none(_floats, _floats, int64, int64, _integers, _integers, _floats, int64))
def spread(x, everything, own, count, begins, parts, factors, d):
    """Write positions or velocities of `count` points, of which `own` are masses."""
    for axis in range(d):
        for i in range(own):
            everything[axis * count + i] = x[axis * own + i]
        for s in range(count - own):
            total = 0.0
            for q in range(index(begins[s]), index(begins[s + 1])):
                total += factors[q] * x[axis * own + index(parts[q])]
            everything[axis * count + own + s] = total
    for k in range(len(x) - d * own):
        everything[d * count + k] = x[d * own + k]


@of_library(none(_floats, _floats, int64, int64, _integers, _integers, _floats, _floats, int64))
def gather(everything, x, own, count, begins, parts, factors, weights, d):
    """Write the accelerations of the masses, from the accelerations of all points."""
    for axis in range(d):
        for i in range(own):
            x[axis * own + i] = everything[axis * count + i]
        for s in range(count - own):
            force = everything[axis * count + own + s]
            for q in range(index(begins[s]), index(begins[s + 1])):
                i = index(parts[q])
                x[axis * own + i] += factors[q] * weights[i] * force
    for k in range(len(x) - d * own):
        x[d * own + k] = everything[d * count + k]


@of_library(float64(_floats, _floats, int64, int64, _floats, int64))
def change(before, after, own, count, weights, d):
    """Replace velocities of all points by their changes; return the sum of M x^2 over them."""
    total = 0.0
    for axis in range(d):
        for i in range(count):
            j = axis * count + i
            after[j] -= before[j]
            total += after[j] * after[j] / (weights[i] if i < own else 1.0)
    return total
