"""What the user chooses of a picture of points: limits, the direction of view, and colours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..functions.checks import reals
from ..result.labels import Labels
from .frames import Color, Frames, colored

_KINDS = "main", "all"
_FORCE = "force"


@dataclass(frozen=True, eq=False)
class Look:
    """How a picture of points looks.

    Attributes
    ----------
    limits : ndarray, shape (2, 2 or 3), or {"main", "all"}
        The corners of the picture, in the unit of its axes; see `Frames.box`.
    camera : (float, float, float), optional
        Azimuth and elevation of the direction of view, degrees, and the distance relative to the usual one.
    color : str
        The name of the quantity that colours points: "speed", "force", or one of `values`; "" for none.
    values : dict of str to ndarray, shape (rows, points)
        The quantities that may colour points, besides their speed.
    t : ndarray, shape (rows,)
        The times of the rows.
    units : dict of str to str
        The units of these quantities, if they are known.
    """

    limits: Any = "main"
    camera: tuple[float, float, float] | None = None
    color: str = ""
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    t: Any = ()
    units: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, mechanism: Any, solution: Any, *, limits: Any = None, camera: Any = None, color: Any = None) -> Look:
        """Check what a user chose, as `Problem.animate` describes it."""
        _, points, dimension = mechanism.places(solution.t[:1], np.reshape(solution.u[0], (1, -1))).shape
        values: dict[str, Any] = {
            name: output
            for name, output in solution.outputs.items()
            if colored(mechanism, points, np.asarray(output)) is not None and np.isfinite(output).all()
        }
        if color is not None and not isinstance(color, str):
            given = reals(color, "color")
            if given.ndim != 2 or len(given) != len(solution.t) or colored(mechanism, points, given) is None:
                raise ValueError(
                    f"color must have a value for each saved time and point, an array of shape ({len(solution.t)}, "
                    f"{points}), not {given.shape}."
                )
            if not np.isfinite(given).all():
                raise ValueError("color must be finite: give points without a value one at the end of the scale.")
            color, values = "color", {**values, "color": given}
        labels = solution.labels or Labels()
        units = {name: labels.unit_of_values(name, range(np.shape(x)[1])) for name, x in values.items()}
        has_forces = mechanism.velocities is not None and len(mechanism.masses) > 0
        if color == _FORCE not in values and has_forces:
            values[_FORCE], units[_FORCE] = _forces(mechanism, solution, points), "N"
        known = list(dict.fromkeys(["speed", *[_FORCE] * has_forces, *values]))
        if color is not None and color not in known:
            raise ValueError(
                f"color must be {' or '.join(map(repr, known))}, or an array of shape (saved times, {points}), not "
                f"{color!r}: an output can colour if it has a finite value for each point."
            )
        return cls(_limits(limits, dimension), _camera(camera, dimension), color or "", values, solution.t, units)

    def colors(self, frames: Frames, names: Any = None) -> list[Color]:
        """Return the colours of frames by the quantities with these names; all of them without names."""
        names = ["speed", *self.values] if names is None else names

        def of(name: str) -> Color:
            if name == "speed":
                return frames.speed()
            return frames.of_points(name, self.units.get(name, ""), np.asarray(self.values[name]), self.t)

        return [of(name) for name in names]


def _forces(mechanism: Any, solution: Any, points: int) -> np.ndarray:
    """Return the size of the total force on each point at the saved times, N: the mass times the acceleration.

    A point without a mass, such as a support or a point of a body, has 0.
    """
    if solution.a is None:
        raise ValueError(
            'color="force" needs the accelerations: load the solution with problem.load(path). Contacts with friction '
            "have none, because their forces depend on their history: give color an array."
        )
    a = np.reshape(solution.a, (len(solution.t), -1))
    moved = mechanism.velocities(solution.t, a) - mechanism.velocities(solution.t, np.zeros_like(a))
    found = np.zeros((len(a), points))
    found[:, : moved.shape[1]] = np.asarray(mechanism.masses) * np.linalg.norm(moved, axis=2)
    found[:, mechanism.vectors] = 0.0
    return found


def _limits(limits: Any, dimension: int) -> Any:
    """Return the corners of the picture, or "main" or "all"."""
    if limits is None or (isinstance(limits, str) and limits in _KINDS):
        return limits or "main"
    wanted = ValueError(
        f'limits must be "main", "all", or the least and the largest coordinate along each of the {dimension} axes, '
        f"such as {((0.0, 1.0),) * dimension}, not {limits!r}."
    )
    try:
        pairs = reals(limits, "limits")
    except (TypeError, ValueError):
        raise wanted from None
    if pairs.shape != (dimension, 2) or not np.isfinite(pairs).all() or not (pairs[:, 0] < pairs[:, 1]).all():
        raise wanted
    return pairs.T


def _camera(camera: Any, dimension: int) -> tuple[float, float, float] | None:
    if camera is None:
        return None
    if dimension == 2:
        raise ValueError("camera needs points in space: leave it out, because these points move in a plane.")
    try:
        if isinstance(camera, str | Mapping):
            raise TypeError
        azimuth, elevation, distance = (*map(float, camera), 1.0)[:3] if len(camera) in (2, 3) else ()
        is_right = math.isfinite(azimuth) and abs(elevation) <= 90 and 0 < distance < math.inf
    except (TypeError, ValueError):
        is_right = False
    if not is_right:
        raise ValueError(
            "camera must be (azimuth, elevation) in degrees, with an elevation from -90 to 90, and optionally a "
            f"positive distance relative to the usual one, such as (-60, 30) or (-60, 30, 2), not {camera!r}."
        )
    return azimuth, elevation, distance
