"""Arithmetic of tuples of one to three numbers, for functions that work in scenes of every dimension.

Numba knows the length of a tuple, and compiles only the branch for it.
"""

import math

from numba.extending import overload
from numba.types import BaseTuple

from ..kernels.compile.jit import OPTIONS, element


@element
def dot(a, b):
    """The scalar product."""
    if len(a) == 1:
        return a[0] * b[0]
    if len(a) == 2:
        return a[0] * b[0] + a[1] * b[1]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@element
def scale(s, a):
    """The multiple s a."""
    if len(a) == 1:
        return (s * a[0],)
    if len(a) == 2:
        return s * a[0], s * a[1]
    return s * a[0], s * a[1], s * a[2]


@element
def add(a, b):
    """The sum."""
    if len(a) == 1:
        return (a[0] + b[0],)
    if len(a) == 2:
        return a[0] + b[0], a[1] + b[1]
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@element
def subtract(a, b):
    """The difference a - b."""
    if len(a) == 1:
        return (a[0] - b[0],)
    if len(a) == 2:
        return a[0] - b[0], a[1] - b[1]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@element
def turn(a, b):
    """The vector product of two vectors; in a plane it is one number, along the normal."""
    if len(a) == 2:
        return (a[0] * b[1] - a[1] * b[0],)
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@element
def cross(w, a):
    """The vector product of a rate of rotation with a vector; in a plane the rate is one number, about the normal."""
    if len(a) == 2:
        return -w[0] * a[1], w[0] * a[0]
    return w[1] * a[2] - w[2] * a[1], w[2] * a[0] - w[0] * a[2], w[0] * a[1] - w[1] * a[0]


def vector(a):
    """The tuple (a,) of a number, and a tuple as it is."""
    return a if isinstance(a, tuple) else (a,)


@overload(vector, jit_options={"forceinline": True, **OPTIONS})
def _vector(a):
    return (lambda a: a) if isinstance(a, BaseTuple) else lambda a: (a,)


@element
def norm(a):
    """The length."""
    return math.sqrt(dot(a, a))
