"""What a page shows of a run: the places and colours of points in each frame, and what does not move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..animation import Film, Mechanism, triangles, wrapped
from ..animation.geometry import in_space
from ..animation.shapes import cut, main_part
from .coding import differences, rounded, text_of

_MANY = 2000  # points: with fewer, there are twice as many frames as in a film
_COLORED = 50  # points: with more, colours show the speed first
_LARGEST = 19e6  # bytes of the data of a page
_BITS, _LEAST_BITS = 16, 8  # of coordinates; fewer than 16 if the data would be too large
_BITS_OF_A_CHARACTER = 6  # of base64
_SHORT = 1e-3  # of the time between frames, for velocities
_TRAIL = 4000  # most places on a trail
_MARGIN = 0.03  # around the motion, relative to its size
_DOT, _BALL, _SUPPORT, _HIDDEN = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class Frames:
    """The motion of the points of a mechanism.

    Attributes
    ----------
    mechanism : Mechanism
    film : Film
    t : ndarray, shape (frames,)
    x : ndarray, shape (frames, points, 3)
        The places; inside the box if there is a periodic one.
    colors : list of (name, unit, values)
        What can be shown by colour, with values of the shape (frames, points).
    """

    mechanism: Mechanism
    film: Film
    t: np.ndarray
    x: np.ndarray
    colors: list[tuple[str, str, np.ndarray]]

    @classmethod
    def of(
        cls, mechanism: Mechanism, film: Film, outputs: Mapping[str, np.ndarray], saved: np.ndarray | None = None
    ) -> Frames:
        """Compute the places in the frames of a film; `outputs` are at the times `saved`."""
        t, places = film.t, mechanism.places
        points = places(t[:1], film.u[:1].reshape(1, -1)).shape[1]
        if points <= _MANY:
            t = np.linspace(t[0], t[-1], 2 * len(t) - 1)
        u, v = (x.reshape(len(t), -1) for x in film.solution._interpolated(t))
        x = in_space(places(t, u))
        short = _SHORT * (t[1] - t[0])
        rates = (places(t + short, u + short * v) - places(t - short, u - short * v)) / (2 * short)
        scale, unit = film.clock if film.clock[0] < 1e-6 or not film.clock[1] else (1.0, "s")
        colors = [("speed", _speed_unit(mechanism.labels, unit), np.linalg.norm(rates, axis=2) * scale)]
        if len(mechanism.box):
            x = wrapped(x, t, mechanism.box, mechanism.shear)
        moving = np.setdiff1d(np.arange(points), mechanism.fixed)
        for name, values in outputs.items():
            if saved is not None and values.ndim == 2 and values.shape[1] in (points, moving.size):
                shown = np.zeros((len(t), points))
                some = np.arange(points) if values.shape[1] == points else moving
                shown[:, some] = np.stack([np.interp(t, saved, column) for column in values.T], axis=1)
                colors.append((name, "", shown))
        return cls(mechanism, film, t, x, colors)

    @property
    def is_flat(self) -> bool:
        """Whether the motion is in a plane, by its labels and its places."""
        return not self.x[..., 2].any()

    @property
    def radii(self) -> np.ndarray:
        """The radius of each point; 0 for points that are dots, or not drawn."""
        given = self.mechanism.radii
        return np.asarray(given, dtype=float) if len(given) else np.zeros(self.x.shape[1])

    @property
    def kinds(self) -> np.ndarray:
        """How each point is drawn."""
        kinds = np.where(self.radii > 0, _BALL, _DOT)
        kinds[np.asarray(self.mechanism.hidden, dtype=int)] = _HIDDEN
        kinds[np.asarray(self.mechanism.fixed, dtype=int)] = _SUPPORT
        return kinds

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners of the box of all motion."""
        low, high = self.x.min(axis=(0, 1)), self.x.max(axis=(0, 1))
        sides = _sides(self.mechanism)
        return np.where(sides > 0, 0.0, low), np.where(sides > 0, sides, high)

    def shown_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners of the box that the camera shows first: without the few points that fly far away."""
        low, high = self.limits()
        around = np.tile(self.radii[:, None], (len(self.t), 1, 3))
        for solid in self.mechanism.solids:
            centre, *ends = solid.points
            around[:, centre] = np.abs(self.x[:, ends] - self.x[:, [centre]]).sum(axis=1)
        if self.is_flat:
            around[..., 2] = 0.0
        low, high = np.minimum(low, (self.x - around).min((0, 1))), np.maximum(high, (self.x + around).max((0, 1)))
        for place, *_ in self.mechanism.marks:
            mark = in_space(np.asarray(place, dtype=float))
            low, high = np.minimum(low, mark), np.maximum(high, mark)
        if self.x.shape[1] > _COLORED:
            low, high = main_part(self.x, low, high)
        if len(self.mechanism.box):
            low, high = (
                np.where(_sides(self.mechanism) > 0, x, y) for x, y in zip(self.limits(), (low, high), strict=True)
            )
        margin = _MARGIN * (high - low).max() * (_sides(self.mechanism) == 0)
        return low - margin, high + margin


def content(frames: Frames, lines: Sequence[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the data of a page as JSON would have it, and long arrays as texts."""
    mechanism, film = frames.mechanism, frames.film
    low, high = frames.shown_limits()
    blocks = {
        "radii": text_of(frames.radii.astype(np.float32)),
        "kinds": text_of(frames.kinds.astype(np.uint8)),
        "links": text_of(np.reshape(mechanism.links, (-1, 2)).astype(np.uint32)),
        "faces": text_of(triangles(mechanism.faces).astype(np.uint32)),
    }
    colors = []
    for k, (name, unit, values) in enumerate(frames.colors):
        least, most = _range(values[:, frames.kinds != _HIDDEN] if len(mechanism.faces) == 0 else values)
        if most > least:
            levels = rounded(values, np.array(least), np.array(most - least), 8)
            blocks[f"color{k}"] = text_of(differences(levels, 8))
            colors.append({"name": name, "unit": unit, "low": least, "high": most, "block": f"color{k}"})
    for k, trail in enumerate(_trails(frames)):
        blocks[f"trail{k}"] = text_of(trail.astype(np.float32))
    positions, bits = _positions(frames, _LARGEST - sum(len(text) for text in blocks.values()))
    at_least, at_most = frames.limits()
    scale, unit = film.clock
    data = {
        "lines": [*lines, mechanism.note] if mechanism.note else list(lines),
        "points": frames.x.shape[1],
        "frames": len(frames.t),
        "time": {"start": float(frames.t[0]), "end": float(frames.t[-1]), "scale": scale, "unit": unit},
        "speed": film.speed,
        "flat": frames.is_flat,
        "bits": bits,
        "motion": [at_least.tolist(), at_most.tolist()],
        "limits": [low.tolist(), high.tolist()],
        "labels": [*mechanism.labels, "", "", ""][:3] if frames.is_flat else list(mechanism.labels),
        "box": _sides(mechanism).tolist() if len(mechanism.box) else None,
        "springs": np.asarray(mechanism.springs, dtype=int).tolist(),
        "until": _until(frames),
        "planes": [corners.tolist() for corners in _planes(frames, low, high)],
        "marks": [{"place": _point(place), "name": name} for place, _, _, name in mechanism.marks],
        "trails": [int(point) for point in mechanism.trails],
        "solids": [{"kind": solid.kind, "points": list(solid.points)} for solid in mechanism.solids],
        "colors": colors,
        "colored": frames.x.shape[1] >= _COLORED and not len(mechanism.faces) and not len(mechanism.links),
    }
    return data, {"positions": positions, **blocks}


def _positions(frames: Frames, largest: float) -> tuple[str, int]:
    """Return the coded positions, with as many bits as `largest` bytes allow, and the number of bits."""
    low, high = frames.limits()
    axes = 2 if frames.is_flat else 3
    bits = _BITS
    while True:
        cells = rounded(frames.x, low, high - low, bits)
        text = text_of(differences(np.swapaxes(cells[..., :axes], 1, 2), bits))
        if len(text) <= largest or bits == _LEAST_BITS:
            return text, bits
        spare = _BITS_OF_A_CHARACTER * (len(text) - largest) / cells[..., :axes].size
        bits = max(_LEAST_BITS, bits - int(np.ceil(spare)))


def _range(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of a scale of colours: the least and the largest value, without the most extreme ones."""
    if not values.size:
        return 0.0, 0.0
    least, most = np.percentile(values, (0.1, 99.9))
    return (0.0 if 0 <= least < most / 4 else float(least)), float(most)


def _speed_unit(labels: Sequence[str], time: str) -> str:
    """Return the unit of speeds, by the unit in the labels of the axes."""
    units = [label.partition("(")[2].rstrip(")") for label in labels if "(" in label]
    length = units[0] if units else "m"
    return "" if length == "-" else f"{length}/{time or 's'}"


def _point(place: Any) -> list[float]:
    return [float(value) for value in in_space(np.asarray(place, dtype=float))]


def _sides(mechanism: Mechanism) -> np.ndarray:
    """Return the sides of the periodic box in space; 0 along an axis that is not periodic."""
    sides = np.zeros(3)
    sides[: len(mechanism.box)] = mechanism.box
    return sides


def _until(frames: Frames) -> list[list[int]]:
    """Return the number of each breakable link, and the last frame in which it is whole."""
    found = []
    for number, dof in dict(frames.mechanism.strings).items():
        u = frames.film.solution._interpolated(frames.t)[0][:, dof]
        broken = np.flatnonzero(u != 0)
        if broken.size:
            found.append([int(number), int(broken[0]) - 1])
    return found


def _planes(frames: Frames, low: np.ndarray, high: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the corners of the parts of planes in the picture; planes of a motion in a plane get a depth."""
    depth = 0.1 * (high - low).max() * frames.is_flat
    deep = np.array([0.0, 0.0, depth])
    for normal, offset in frames.mechanism.planes:
        corners = cut(in_space(np.asarray(normal, dtype=float)), float(offset), low - deep, high + deep)
        if len(corners):
            yield corners


def _trails(frames: Frames) -> Iterator[np.ndarray]:
    """Yield the path of each point with a trail, as rows of the time and the place."""
    mechanism, film = frames.mechanism, frames.film
    if not len(mechanism.trails) or len(mechanism.box):
        return
    some = slice(None, None, 1 + len(film.times) // _TRAIL)
    paths = film.path(lambda t, u: mechanism.places(t, u.reshape(len(t), -1))[:, list(mechanism.trails)])
    for path in np.moveaxis(paths[some], 1, 0):
        yield np.column_stack([film.times[some], in_space(path)])
