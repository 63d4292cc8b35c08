"""What a page has of a run: its data as JSON, and the places and colours of points as coded texts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..animation import Film, Mechanism, triangles
from ..animation.frames import Color, Frames
from ..animation.geometry import in_space
from ..animation.look import Look
from ..animation.shapes import cut
from .coding import differences, rounded, text_of

_MANY = 2000  # points: with fewer, there are twice as many frames as in a film
_COLORED = 50  # points: with more, colours show the speed first
_LARGEST = 19e6  # bytes of the data of a page
_BITS, _LEAST_BITS = 16, 8  # of coordinates; fewer than 16 if the data would be too large
_BITS_OF_A_CHARACTER = 6  # of base64
_TRAIL = 4000  # most places on a trail
_MARGIN = 0.03  # around the motion, relative to its size
_DOT, _BALL, _SUPPORT, _HIDDEN = 0, 1, 2, 3


def frames_of(mechanism: Mechanism, film: Film) -> Frames:
    """Return the frames of a page: twice as many as in a film, unless there are many points."""
    points = mechanism.places(film.t[:1], film.u[:1].reshape(1, -1)).shape[1]
    twice = np.linspace(film.t[0], film.t[-1], 2 * len(film.t) - 1)
    return Frames.of(mechanism, film, twice if points <= _MANY else None)


def _kinds(frames: Frames) -> np.ndarray:
    """Return how each point is drawn."""
    kinds = np.where(frames.radii > 0, _BALL, _DOT)
    kinds[np.asarray(frames.mechanism.hidden, dtype=int)] = _HIDDEN
    kinds[np.asarray(frames.mechanism.fixed, dtype=int)] = _SUPPORT
    return kinds


def _shown_limits(frames: Frames, limits: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the box that the camera shows first."""
    low, high = frames.box(limits, frames.mechanism.solids)
    is_periodic = np.zeros(low.size, dtype=bool)
    is_periodic[: len(frames.mechanism.box)] = np.asarray(frames.mechanism.box) > 0
    margin = _MARGIN * (high - low).max() * (~is_periodic & isinstance(limits, str))
    return in_space(low - margin), in_space(high + margin)


def content(
    frames: Frames, given: Sequence[Color], lines: Sequence[str], look: Look
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the data of a page with the given colours as JSON would have it, and long arrays as texts."""
    mechanism, film = frames.mechanism, frames.film
    x, kinds = in_space(frames.x), _kinds(frames)
    is_flat = not x[..., 2].any()
    low, high = _shown_limits(frames, look.limits)
    many = x.shape[1] >= _COLORED and not len(mechanism.faces) and not len(mechanism.links)
    blocks = {
        "radii": text_of(frames.radii.astype(np.float32)),
        "kinds": text_of(kinds.astype(np.uint8)),
        "links": text_of(np.reshape(mechanism.links, (-1, 2)).astype(np.uint32)),
        "faces": text_of(triangles(mechanism.faces).astype(np.uint32)),
    }
    colors = []
    for k, color in enumerate(given):
        name, unit, values = color
        least, most = color.range(frames.visible)
        if most > least or name == look.color:
            most = most if most > least else least + 1.0
            levels = rounded(values, np.array(least), np.array(most - least), 8)
            blocks[f"color{k}"] = text_of(differences(levels, 8))
            colors.append({"name": name, "unit": unit, "low": least, "high": most, "block": f"color{k}"})
    for k, trail in enumerate(_trails(frames)):
        blocks[f"trail{k}"] = text_of(trail.astype(np.float32))
    motion = mechanism.in_box(x.min(axis=(0, 1)), x.max(axis=(0, 1)))
    spare = _LARGEST - sum(len(text) for text in blocks.values())
    positions, bits = _positions(x[..., : 3 - is_flat], *motion, largest=spare)
    scale, unit = film.clock
    data = {
        "lines": [*lines, mechanism.note] if mechanism.note else list(lines),
        "points": x.shape[1],
        "frames": len(frames.t),
        "time": {"start": float(frames.t[0]), "end": float(frames.t[-1]), "scale": scale, "unit": unit},
        "speed": film.speed,
        "flat": is_flat,
        "bits": bits,
        "motion": [corner.tolist() for corner in motion],
        "limits": [low.tolist(), high.tolist()],
        "labels": [*mechanism.labels, "", "", ""][:3] if is_flat else list(mechanism.labels),
        "box": _sides(mechanism).tolist() if len(mechanism.box) else None,
        "springs": np.asarray(mechanism.springs, dtype=int).tolist(),
        "until": _until(frames),
        "planes": [corners.tolist() for corners in _planes(mechanism, low, high, is_flat=is_flat)],
        "marks": [{"place": _point(place), "name": name} for place, _, _, name in mechanism.marks],
        "trails": [int(point) for point in mechanism.trails],
        "solids": [{"kind": solid.kind, "points": list(solid.points)} for solid in mechanism.solids],
        "colors": colors,
        "colored": look.color or ("speed" if many else ""),
        "camera": look.camera,
    }
    return data, {"positions": positions, **blocks}


def _positions(x: np.ndarray, low: np.ndarray, high: np.ndarray, *, largest: float) -> tuple[str, int]:
    """Return the coded positions, with as many bits as `largest` bytes allow, and the number of bits."""
    axes = x.shape[2]
    bits = _BITS
    while True:
        cells = rounded(x, low[:axes], (high - low)[:axes], bits)
        text = text_of(differences(np.swapaxes(cells, 1, 2), bits))
        if len(text) <= largest or bits == _LEAST_BITS:
            return text, bits
        spare = _BITS_OF_A_CHARACTER * (len(text) - largest) / cells.size
        bits = max(_LEAST_BITS, bits - int(np.ceil(spare)))


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
        broken = np.flatnonzero(frames.u[:, dof] != 0)
        if broken.size:
            found.append([int(number), int(broken[0]) - 1])
    return found


def _planes(mechanism: Mechanism, low: np.ndarray, high: np.ndarray, *, is_flat: bool) -> Iterator[np.ndarray]:
    """Yield the corners of the parts of planes in the picture; planes of a motion in a plane get a depth."""
    depth = 0.1 * (high - low).max() * is_flat
    deep = np.array([0.0, 0.0, depth])
    for normal, offset in mechanism.planes:
        corners = cut(in_space(np.asarray(normal, dtype=float)), float(offset), low - deep, high + deep)
        if len(corners):
            yield corners


def _trails(frames: Frames) -> Iterator[np.ndarray]:
    """Yield the path of each point with a trail, as rows of the time and the place."""
    film = frames.film
    for path in frames.paths:
        some = slice(None, None, 1 + len(path) // _TRAIL)
        yield np.column_stack([film.times[some], in_space(path[some])])
