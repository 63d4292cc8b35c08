"""A law of links in a joint: its stretch is the angle of a hinge, or the displacement of a slide."""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from ..kernels.compile.jit import element
from ..kernels.slide import displacement, displacement_rate, forces_along
from ..kernels.vector_angle import (
    angle_in_plane,
    angle_in_space,
    couple_in_plane,
    couple_in_space,
    rate_in_plane,
    rate_in_space,
)
from .cell import Cell
from .effect import JUMPING, RATE, Arrays, Columns, Effect, arguments
from .of_law import OfLaw, call_of, calling

_OF_JOINT = ("t", "x", "v", "state")
_PULLS = {"tension": "", "force_density": " * r"}
_SAME = 1e-9  # difference of two torques that are equal, relative to these and another torque: sin(pi) is not 0


@element
def angle_of_jump(angle: Any, after: Any, before: Any, other: Any) -> Any:
    """Return the angle, or 0 if the torque does not jump where the angle changes from pi to -pi."""
    return angle if abs(after - before) > _SAME * (abs(after) + abs(before) + abs(other)) else 0.0


@dataclass(frozen=True, eq=False)
class HingeLaw(OfLaw, Cell):
    """A law between two bodies, which have the vectors x0 and x1 in the plane.

    `kinematics` has three functions: the angle, its rate, and the forces of a torque that increases it. Angles are
    smaller than `reach`.
    """

    law: Any

    takes = (2,)
    dimensions = (2,)
    reach: ClassVar[float] = math.pi
    kinematics: ClassVar[tuple[Any, Any, Any]] = angle_in_plane, rate_in_plane, couple_in_plane
    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        **dict.fromkeys(("forces", "event", "state_after", RATE, JUMPING), _OF_JOINT),
        "potential": ("x", "state"),
    }

    def __post_init__(self) -> None:
        self.check_law()
        if "rate_after" in self.law.functions():
            raise TypeError(f"{self.law.title} changes velocities at events, which a hinge does not support.")
        super().__post_init__()

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        super().check_points(masses, positions, columns)
        rest = np.abs(columns.get("rest_length", np.zeros(1)))
        self.require(rest < self.reach, "rest_length must be between -pi and pi in a hinge, in rad")
        if hasattr(self.law, "check_whole"):
            self.law.check_whole(columns, np.zeros(1))

    @property
    def title(self) -> str:
        return str(self.law.title)

    @property
    def source(self) -> str:  # type: ignore[override]
        return str(self.law.source)

    crossing = property(attrgetter("law.crossing"))  # type: ignore[assignment]
    at_start = property(attrgetter("law.at_start"))  # type: ignore[assignment]
    turns = property(attrgetter("law.turns"))  # type: ignore[assignment]

    def functions(self) -> dict[str, Any]:
        wraps = self.reach == math.pi
        return dict(_of_joint(tuple(self.law.functions().items()), self.takes[0], self.kinematics, wraps))

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        check = Cell._check_returned if name == "forces" else Effect._check_returned
        check(self, name, returned, dimension)


@dataclass(frozen=True, eq=False)
class HingeLawInSpace(HingeLaw):
    """A law about the unit vector x2 of the second body, which is perpendicular to x0 and x1."""

    takes = (3,)
    dimensions = (3,)
    needs_hinge = True
    kinematics = angle_in_space, rate_in_space, couple_in_space


@dataclass(frozen=True, eq=False)
class SlideLaw(HingeLawInSpace):
    """A law for the displacement of the point x0 of a body from x1 of the second body along its unit vector x2."""

    needs_hinge = False
    reach = math.inf
    kinematics = displacement, displacement_rate, forces_along


@functools.lru_cache(256)
def _of_joint(inner: tuple[tuple[str, Any], ...], points: int, kinematics: tuple[Any, Any, Any], wraps: bool) -> Any:
    """Return functions of the points that call a law. The same law gives the same functions, so scenes share code."""
    law, calls = dict(inner), {name: call_of(name, function) for name, function in inner}
    acting = [name for name in ("torque", *_PULLS) if name in law]
    force = calls.get("torque") or f"-({' + '.join(calls[name] + _PULLS[name] for name in acting)})"
    results = {name: calls[name] for name in ("potential", "event", "state_after", RATE) if name in law}
    results["forces"] = f"forces_of(x, {force})"
    of_law = "angle" if "torque" in law else "r"  # of a motor, or of a link, which may have a field angle
    torques = [re.sub(rf"\b{of_law}\b", repr(at), force) for at in (-math.pi, math.pi, 1.0)]
    if wraps and force not in torques:
        results[JUMPING] = f"angle_of_jump({of_law}, {', '.join(torques)})"
    of_points = {of_law: f"r_of({', '.join(f'x[{k}]' for k in range(points))})", "rate": "rate_of(x, v)"}
    lines = {}
    for name, result in results.items():
        read = re.findall(r"\w+", result)
        lines[name] = [f"{x} = {value}" for x, value in of_points.items() if x in read] + [f"return {result}"]
    known = {"t", "x", "v", "state", *(x for f in law.values() for x in arguments(f))} - {*of_points}
    names = dict(zip(("r_of", "rate_of", "forces_of"), kinematics, strict=True))
    return calling(law, lines, known, "joint", {"__name__": __name__, "angle_of_jump": angle_of_jump, **names})
