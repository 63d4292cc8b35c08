"""Arithmetic of tuples of one to three numbers, for functions that work in scenes of every dimension."""

import math

from numba.extending import overload
from numba.types import BaseTuple

from ..kernels.compile.jit import OPTIONS, element

_INLINED = {"forceinline": True, **OPTIONS}


def dot(a, b):
    """The scalar product."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def scale(s, a):
    """The multiple s a."""
    return tuple(s * x for x in a)


def add(a, b):
    """The sum."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def subtract(a, b):
    """The difference a - b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def turn(a, b):
    """The vector product of two vectors; in a plane it is one number, along the normal."""
    if len(a) == 2:
        return (a[0] * b[1] - a[1] * b[0],)
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def cross(w, a):
    """The vector product of a rate of rotation with a vector; in a plane the rate is one number, about the normal."""
    if len(a) == 2:
        return -w[0] * a[1], w[0] * a[0]
    return w[1] * a[2] - w[2] * a[1], w[2] * a[0] - w[0] * a[2], w[0] * a[1] - w[1] * a[0]


def vector(a):
    """The tuple (a,) of a number, and a tuple as it is."""
    return a if isinstance(a, tuple) else (a,)


@overload(dot, jit_options=_INLINED)
def _dot(a, b):
    return {
        1: lambda a, b: a[0] * b[0],
        2: lambda a, b: a[0] * b[0] + a[1] * b[1],
        3: lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
    }[a.count]


@overload(scale, jit_options=_INLINED)
def _scale(s, a):
    return {
        1: lambda s, a: (s * a[0],),
        2: lambda s, a: (s * a[0], s * a[1]),
        3: lambda s, a: (s * a[0], s * a[1], s * a[2]),
    }[a.count]


@overload(add, jit_options=_INLINED)
def _add(a, b):
    return {
        1: lambda a, b: (a[0] + b[0],),
        2: lambda a, b: (a[0] + b[0], a[1] + b[1]),
        3: lambda a, b: (a[0] + b[0], a[1] + b[1], a[2] + b[2]),
    }[a.count]


@overload(subtract, jit_options=_INLINED)
def _subtract(a, b):
    return {
        1: lambda a, b: (a[0] - b[0],),
        2: lambda a, b: (a[0] - b[0], a[1] - b[1]),
        3: lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2]),
    }[a.count]


@overload(turn, jit_options=_INLINED)
def _turn(a, b):
    return {
        2: lambda a, b: (a[0] * b[1] - a[1] * b[0],),
        3: lambda a, b: (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]),
    }[a.count]


@overload(cross, jit_options=_INLINED)
def _cross(w, a):
    return {
        2: lambda w, a: (-w[0] * a[1], w[0] * a[0]),
        3: lambda w, a: (w[1] * a[2] - w[2] * a[1], w[2] * a[0] - w[0] * a[2], w[0] * a[1] - w[1] * a[0]),
    }[a.count]


@overload(vector, jit_options=_INLINED)
def _vector(a):
    return (lambda a: a) if isinstance(a, BaseTuple) else lambda a: (a,)


@element
def norm(a):
    """The length."""
    return math.sqrt(dot(a, a))
