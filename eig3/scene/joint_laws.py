"""Springs, dampers and motors of joints in space, which act on the angle of a hinge or the displacement of a slide."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from ..functions.callbacks import jit
from ..kernels.compile.jit import element
from ..kernels.friction import couple_in_space, rate_in_space
from ..kernels.vector_angle import angle_in_space
from .cell import Cell, offers_of
from .effect import arguments


@element
def angle(x):  # type: ignore[no-untyped-def]
    return angle_in_space(x[0], x[1], x[2])


@element
def turning_forces(x, force):  # type: ignore[no-untyped-def]
    return couple_in_space(x, -force)


@element
def product(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@element
def displacement(x):  # type: ignore[no-untyped-def]
    return product(x[0], x[2]) - product(x[1], x[2])


@element
def sliding_rate(x, v):  # type: ignore[no-untyped-def]
    return product(v[0], x[2]) - product(v[1], x[2]) + product(x[0], v[2]) - product(x[1], v[2])


@element
def sliding_forces(x, force):  # type: ignore[no-untyped-def]
    """The force on the axis has the moment of both forces about the other body."""
    a, b, e = x
    return (
        (-force * e[0], -force * e[1], -force * e[2]),
        (force * e[0], force * e[1], force * e[2]),
        (force * (b[0] - a[0]), force * (b[1] - a[1]), force * (b[2] - a[2])),
    )


class HingeLaw(Cell):
    """A torque about the unit vector x2 of a body, on the vector x0 of another body and the vector x1 of the first.

    `force` is the derivative of the potential with respect to the angle from x1 to x0, from -pi to pi, rad.
    """

    takes = (3,)
    dimensions = (3,)
    variable, conjugate = "q", "force"
    offers = offers_of(variable, conjugate)
    needs = (conjugate,)
    value, rate, forces = angle, rate_in_space, turning_forces


class SlideLaw(HingeLaw):
    """A force between the points x0 and x1 of two bodies along the unit vector x2 of the second body.

    `force` is the derivative of the potential with respect to the displacement (x0 - x1) . x2, m.
    """

    value, rate, forces = displacement, sliding_rate, sliding_forces


@dataclass(frozen=True, eq=False)
class HingeSpring(HingeLaw):
    """A spring with a stiffness, N m/rad or N/m, and the coordinate at which its force is 0."""

    stiffness: ArrayLike
    rest: ArrayLike

    nonnegative = ("stiffness",)
    source = "Hooke"

    @staticmethod
    @element
    def force(q, stiffness, rest):  # type: ignore[no-untyped-def]
        return stiffness * (q - rest)

    @staticmethod
    @element
    def potential(q, stiffness, rest):  # type: ignore[no-untyped-def]
        return stiffness / 2 * (q - rest) * (q - rest)


@dataclass(frozen=True, eq=False)
class HingeDamper(HingeLaw):
    """A damper with a coefficient, N m s or N s/m."""

    damping: ArrayLike

    nonnegative = ("damping",)

    @staticmethod
    @element
    def force(rate, damping):  # type: ignore[no-untyped-def]
        return damping * rate


@dataclass(frozen=True, eq=False)
class HingeMotor(HingeLaw):
    """A motor whose force is a control between two limits, times a gear."""

    control: Callable
    gear: ArrayLike
    low: ArrayLike
    high: ArrayLike

    source = "prescribed by the user"

    @property
    def force(self) -> Any:
        return _controlled(self.control, len(arguments(self.control)))


class SlideSpring(SlideLaw, HingeSpring):
    """A spring of a slide."""


class SlideDamper(SlideLaw, HingeDamper):
    """A damper of a slide."""


class SlideMotor(SlideLaw, HingeMotor):
    """A motor of a slide."""


@jit
def steady(t):  # type: ignore[no-untyped-def]
    return 1.0


@functools.cache
def _controlled(control: Any, count: int) -> Any:
    """Return the same function for the same control: scenes with the same functions share their code."""

    @jit
    def of_time(t, gear, low, high):  # type: ignore[no-untyped-def]
        return -gear * min(max(control(t), low), high)

    @jit
    def of_joint(t, q, rate, gear, low, high):  # type: ignore[no-untyped-def]
        return -gear * min(max(control(t, q, rate), low), high)

    return of_time if count == 1 else of_joint
