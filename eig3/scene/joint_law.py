"""A law of links in a joint: its stretch is the angle of a hinge, or the displacement of a slide."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from ..functions.callbacks import jit
from ..kernels.compile.source import Writer, define
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
from .effect import RATE, Effect, arguments
from .of_law import OfLaw

_OF_JOINT = ("t", "x", "v", "state")
_PULLS = {"tension": "", "force_density": " * r"}


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
        **dict.fromkeys(("forces", "event", "state_after", RATE), _OF_JOINT),
        "potential": ("x", "state"),
    }

    def __post_init__(self) -> None:
        self.check_law()
        if "rate_after" in self.law.functions():
            raise TypeError(f"{self.law.title} changes velocities at events, which a hinge does not support.")
        super().__post_init__()

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
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
        return dict(_of_joint(tuple(self.law.functions().items()), self.takes[0], self.kinematics))

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
def _of_joint(inner: tuple[tuple[str, Any], ...], points: int, kinematics: tuple[Any, Any, Any]) -> Any:
    """Return functions of the points that call a law. The same law gives the same functions, so scenes share code."""
    known, out = dict(inner), Writer()
    calls = {name: f"law_{name}({', '.join(arguments(function))})" for name, function in inner}
    acting = [name for name in ("torque", *_PULLS) if name in known]
    force = calls.get("torque") or f"-({' + '.join(calls[name] + _PULLS[name] for name in acting)})"
    given = {
        name: (arguments(known[name]), calls[name])
        for name in ("potential", "event", "state_after", RATE)
        if name in known
    }
    of_forces = [x for name in acting for x in arguments(known[name])] + ["r"] * ("force_density" in known)
    given["forces"] = tuple(of_forces), f"forces_of(x, {force})"
    for name, (read, value) in given.items():
        of_points = [x for x in ("r", "angle", "rate") if x in read]
        taken = ["x"] * bool(of_points or name == "forces") + ["v"] * ("rate" in read)
        taken += [x for x in dict.fromkeys(read) if x not in of_points]
        with out.block(f"def {name}({', '.join(taken)})"):
            for variable in of_points:
                from_points = f"r_of({', '.join(f'x[{k}]' for k in range(points))})"
                out.line(f"{variable} = {'rate_of(x, v)' if variable == 'rate' else from_points}")
            out.line(f"return {value}")
    names = dict(zip(("r_of", "rate_of", "forces_of"), kinematics, strict=True))
    names |= {"__name__": __name__, **{f"law_{name}": function for name, function in inner}}
    defined = define(str(out), "joint", names)
    return tuple((name, jit(defined[name])) for name in given)
