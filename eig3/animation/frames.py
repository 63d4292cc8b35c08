"""What a film or a page shows of a run: the places and colours of points in each frame, and the limits around them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .film import Film
from .shapes import Solid, are_near, half_size, wrapped

_SHORT = 1e-3  # of the time between frames, for velocities


class Color(NamedTuple):
    """A quantity that colours points, with values of the shape (frames, points)."""

    name: str
    unit: str
    values: np.ndarray

    def range(self, some: Any = slice(None)) -> tuple[float, float]:
        """Return the ends of the scale for some points: the least and the largest value, without the most extreme."""
        if not self.values[:, some].size:
            return 0.0, 0.0
        least, most = np.percentile(self.values[:, some], (0.1, 99.9))
        return (0.0 if 0 <= least < most / 4 else float(least)), float(most)


@dataclass(frozen=True, eq=False)
class Frames:
    """The motion of the points of a mechanism.

    u and v have the shape (frames, n), and the places x the shape (frames, points, 2 or 3): inside the box if there is
    a periodic one.
    """

    mechanism: Any
    film: Film
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    x: np.ndarray

    @classmethod
    def of(cls, mechanism: Any, film: Film, t: np.ndarray | None = None) -> Frames:
        """Compute the places in the frames of a film, or at other times within it."""
        states = (film.u, film.v) if t is None else film.solution._interpolated(t)
        t = film.t if t is None else t
        u, v = (np.reshape(state, (len(t), -1)) for state in states)
        x = mechanism.places(t, u)
        return cls(mechanism, film, t, u, v, wrapped(x, t, mechanism.box, mechanism.shear) if len(mechanism.box) else x)

    @cached_property
    def paths(self) -> list[np.ndarray]:
        """The path of each point with a trail, shape (times, 2 or 3)."""
        places, trails = self.mechanism.places, list(self.mechanism.trails)
        if not trails or len(self.mechanism.box):
            return []
        return list(np.moveaxis(self.film.path(lambda t, u: places(t, u.reshape(len(t), -1))[:, trails]), 1, 0))

    @property
    def radii(self) -> np.ndarray:
        """The radius of each point; 0 for points that are dots, or not drawn."""
        given = self.mechanism.radii
        return np.asarray(given, dtype=float) if len(given) else np.zeros(self.x.shape[1])

    @cached_property
    def near(self) -> np.ndarray:
        """The numbers of the points without the few that fly far away, and without those that show axes of bodies."""
        own = _without_ends(self.mechanism, self.x.shape[1])
        return np.asarray(own[are_near(self.x[:, own].min(axis=0), self.x[:, own].max(axis=0))])

    @property
    def visible(self) -> np.ndarray:
        """The numbers of the near points whose values are visible as colours."""
        return np.intersect1d(self.near, self.mechanism.seen(self.x.shape[1]))

    def box(
        self, limits: Any, solids: Iterable[Solid], places: Iterable[np.ndarray] = ()
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return two corners of the box that is shown, from the limits of a `Look`.

        It contains the `solids`, which are the bodies that are drawn, and more `places`, each of the shape (k, 2 or 3).
        """
        if not isinstance(limits, str):
            return limits[0], limits[1]
        size = self.radii[:, None] * np.ones(self.x.shape[2])
        least, most = self.x.min(axis=0) - size, self.x.max(axis=0) + size
        for solid in solids:
            centre, *others = solid.points
            half = half_size(solid.kind, self.x[:, others] - self.x[:, [centre]])
            least[centre], most[centre] = (self.x[:, centre] - half).min(axis=0), (self.x[:, centre] + half).max(axis=0)
        some = self.near if limits == "main" else _without_ends(self.mechanism, self.x.shape[1])
        low, high = least[some].min(axis=0), most[some].max(axis=0)
        for place in (*places, *(np.atleast_2d(place) for place, *_ in self.mechanism.marks)):
            low, high = np.minimum(low, place.min(axis=0)), np.maximum(high, place.max(axis=0))
        return self.mechanism.in_box(low, high)

    def speed(self) -> Color:
        """Return the speed of each point, in the unit of length of the axes."""
        t, places = self.t, self.mechanism.places
        short = _SHORT * (t[1] - t[0])
        rates = (places(t + short, self.u + short * self.v) - places(t - short, self.u - short * self.v)) / (2 * short)
        scale, unit = self.film.clock if self.film.clock[0] < 1e-6 or not self.film.clock[1] else (1.0, "s")
        return Color("speed", self._speed_unit(unit), np.linalg.norm(rates, axis=2) * scale)

    def _speed_unit(self, time: str) -> str:
        units = [label.partition("(")[2].rstrip(")") for label in self.mechanism.labels if "(" in label]
        length = units[0] if units else "m"
        return "" if length == "-" else f"{length}/{time or 's'}"

    def of_points(self, name: str, unit: str, values: np.ndarray, saved: np.ndarray) -> Color:
        """Return the colours by values of the shape (rows, points) at the times `saved`, which `colored` accepts."""
        points = self.x.shape[1]
        shown = np.zeros((len(self.t), points))
        some = colored(self.mechanism, points, values)
        shown[:, some] = np.stack([np.interp(self.t, saved, column) for column in values.T], axis=1)
        return Color(name, unit, shown)


def colored(mechanism: Any, points: int, values: np.ndarray) -> np.ndarray | None:
    """Return the numbers of the points to which the columns of values belong, or None if their shape does not fit.

    The columns are all points, or those without the points that only show the axes of bodies, or the moving ones.
    """
    every = np.arange(points)
    own = np.setdiff1d(_without_ends(mechanism, points), mechanism.vectors)
    kinds = every, own, np.setdiff1d(every, mechanism.fixed), np.setdiff1d(own, mechanism.fixed)
    return next((some for some in kinds if values.ndim == 2 and values.shape[1] == some.size), None)


def _without_ends(mechanism: Any, points: int) -> np.ndarray:
    """Return the numbers of the points that are more than the ends of the axes of bodies."""
    return np.setdiff1d(np.arange(points), [point for solid in mechanism.solids for point in solid.points[1:]])
