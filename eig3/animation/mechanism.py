"""A view of points, links, faces, supports and planes, in the plane and in space, true to scale."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..geometry import Geometry
from .axes import Discs, Faces, Plane, Space, Tints, axes_of, scale_of
from .film import Film, Places
from .frames import Frames
from .look import Look
from .shapes import Solid, coils, edges_of_box, surface

_COILS = 40  # more springs than this are drawn as lines
_MARGIN = 0.08  # around the motion, relative to its size
_LEAST = 0.5  # least side of the box in space, relative to its longest side
_TRAIL = 0.7  # seconds of the film
_CLEAR = 0.5  # opacity of bodies in space with links, which end within them
_SIZES = (30, 7.0), (300, 3.0)  # up to this number of points: size of the dots


def in_plane(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the positions of a point whose coordinates in a plane are u, for `Mechanism`."""
    return u[:, None]


@dataclass(frozen=True, eq=False)
class Magnified:
    """Positions with magnified displacements: ``places(t, u)``.

    Attributes
    ----------
    places : callable
        The function of the positions to magnify.
    factor : float
    start : ndarray, shape (points, 2 or 3)
        The positions from which the displacements are measured.
    """

    places: Places
    factor: float
    start: np.ndarray

    def __call__(self, t: np.ndarray, u: np.ndarray) -> np.ndarray:
        return self.start + self.factor * (self.places(t, u) - self.start)


@dataclass(frozen=True, eq=False)
class Mechanism(Geometry):
    """Moving points, links and faces between them, supports and planes.

    The fields of `Geometry` come first; only `places` is needed. In a picture, a point with a radius is a disc, or in
    space a ball, and others are dots. `cells`, `bodies`, `masses`, `velocities` and `spins` are not drawn.

    Attributes
    ----------
    springs : sequence of int
        The numbers of the links that are drawn as springs.
    faces : array_like of int, shape (faces, corners)
        The numbers of the corners of each face of a surface. In space faces are shaded by their direction to the light.
    hidden : sequence of int
        The numbers of the points that are not drawn, such as the points of a surface.
    planes : sequence of (normal, offset)
        Planes normal . x = offset, whose normal points to the free side.
    trails : sequence of int
        The numbers of the points with a trail.
    marks : sequence of (place, style, size, name)
        Static marks, such as the sun, with a format string of matplotlib as style, such as "C1o".
    labels : tuple of str
        Labels of the axes; an axis without a label has no scale.
    note : str
        A line below the picture, such as how much the displacements are magnified.
    solids : sequence of Solid
        The shapes of rigid bodies.
    """

    springs: Any = ()
    faces: Any = ()
    hidden: Any = ()
    planes: Any = ()
    trails: Any = ()
    marks: Any = ()
    labels: tuple[str, ...] = ("x (m)", "y (m)", "z (m)")
    note: str = ""
    solids: Any = ()

    @property
    def geometry(self) -> Geometry:
        """The points, the links and the triangles of the faces, without velocities and masses."""
        faces = np.asarray(self.faces)
        cells = [faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)] if len(faces) else []
        given = {name: getattr(self, name) for name in ("places", "links", "strings", "fixed", "radii")}
        return Geometry(cells=cells, **given)

    def __call__(self, figure: Any, film: Film, look: Look | None = None) -> Callable[[int], None]:
        look = look or Look()
        frames = Frames.of(self, film)
        paths = frames.paths
        low, high = frames.box(look.limits, self._drawn, paths)
        is_exact = not isinstance(look.limits, str)
        low, high = (low, high) if is_exact else _with_margin(low, high)
        axes = axes_of(figure, low, high, self.labels, self.note, look.camera, is_exact=is_exact)
        draw: Any = Plane(axes) if low.size == 2 else Space(axes)
        x, *paths = (shown if low.size == 2 else _inside(shown, low, high) for shown in (frames.x, *paths))
        self._draw_still(draw, low, high)
        tints = self._tints(figure, axes, frames, look)
        movers = [*_trails(draw, paths, film), *self._links(draw, x, film, high - low)]
        movers += draw.polygons(self._polygons(frames.x, x, tints), self._discs(x, frames.radii, tints))
        movers += self._dots(draw, x, frames.radii, tints)

        def show(i: int) -> None:
            for move in movers:
                move(i)

        return show

    def _draw_still(self, draw: Any, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the planes, the periodic box and the marks."""
        for normal, offset in self.planes:
            draw.plane(np.asarray(normal, dtype=float), float(offset), low, high)
        if len(self.box):
            draw.lines(color="0.6", linewidth=0.8).set_segments(edges_of_box(*self.in_box(low, high)))
        for place, style, width, name in self.marks:
            draw.axes.plot(*np.reshape(place, (-1, 1)), style, markersize=width)
            draw.axes.text(*place, f"\n{name}", ha="center", va="top", linespacing=0.8)

    @property
    def _drawn(self) -> list[Solid]:
        """The solids that are drawn: links show the other bodies."""
        linked = set(np.ravel(self.links).tolist())
        return [solid for solid in self.solids if solid.is_given or solid.points[0] not in linked]

    def _tints(self, figure: Any, axes: Any, frames: Frames, look: Look) -> Callable[[Any], Tints | None]:
        """Return the function of the colours of points with these numbers, which may be an array of any shape."""
        if not look.color:
            return lambda some: None
        (color,) = look.colors(frames, [look.color])
        scale = scale_of(figure, axes, color, frames.visible)

        def tints(some: Any) -> Tints:
            values = color.values[:, some]
            return Tints(values if values.ndim == 2 else values.mean(axis=2), scale)

        return tints

    def seen(self, points: int) -> np.ndarray:
        """Return the numbers of the points whose values are visible as colours."""
        shown = np.setdiff1d(np.arange(points), [*np.ravel(self.hidden), *np.ravel(self.fixed)])
        return np.union1d(shown, [*np.ravel(self.faces), *(solid.points[0] for solid in self._drawn)]).astype(int)

    def _polygons(self, whole: np.ndarray, x: np.ndarray, tints: Callable[[Any], Any]) -> list[Faces]:
        """Return the faces of the surface and of the bodies; of these, the centre must be within the limits."""
        faces = [Faces(x[:, np.asarray(self.faces)], tints=tints(np.asarray(self.faces)))] if len(self.faces) else []
        kinds: dict[int, list[Solid]] = {}
        for solid in self._drawn:
            kinds.setdefault(surface(solid, whole[:1]).shape[2], []).append(solid)
        for _, solids in sorted(kinds.items()):
            shown = [np.where(np.isfinite(x[:, None, None, s.points[0]]), surface(s, whole), np.nan) for s in solids]
            centres = np.repeat([s.points[0] for s in solids], [each.shape[1] for each in shown])
            opacity = _CLEAR if len(self.links) else 1.0
            faces.append(Faces(np.concatenate(shown, axis=1), opacity, tints(centres)))
        return faces

    def _discs(self, x: np.ndarray, radii: np.ndarray, tints: Callable[[Any], Any]) -> list[Discs]:
        is_fixed = np.isin(np.arange(x.shape[1]), self.fixed)
        groups = [(np.flatnonzero((is_fixed == fixed) & (radii > 0)), fixed) for fixed in (True, False)]
        return [
            Discs(x[:, some], radii[some], *(("0.5", None) if fixed else ("C0", tints(some))))
            for some, fixed in groups
            if some.size
        ]

    def _dots(
        self, draw: Any, x: np.ndarray, radii: np.ndarray, tints: Callable[[Any], Any]
    ) -> Iterator[Callable[[int], None]]:
        """Draw the points without radii, and yield the functions that move them."""
        numbers = np.arange(x.shape[1])
        is_fixed: Any = np.isin(numbers, self.fixed)
        size = next((size for most, size in _SIZES if x.shape[1] <= most), 1.5)
        centres = [solid.points[0] for solid in self._drawn]
        is_dot = (radii == 0) & ~np.isin(numbers, [*self.hidden, *centres])
        for some, style in ((is_dot & is_fixed, ("k", "^")), (is_dot & ~is_fixed, ("C0", "o"))):
            colors = tints(np.flatnonzero(some)) if style[1] == "o" else None
            if some.any() and colors is not None:
                yield draw.dots(x[:, some], size, colors)
            elif some.any():
                dots = draw.line(linestyle="none", markersize=size, zorder=3, color=style[0], marker=style[1])
                yield partial(_move_points, partial(draw.move, dots), x[:, some])

    def in_box(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return two corners of the periodic box, which reaches from low to high along axes that are not periodic."""
        sides = np.zeros(low.size)
        sides[: len(self.box)] = self.box
        return np.where(sides > 0, 0.0, low), np.where(sides > 0, sides, high)

    def _links(self, draw: Any, x: np.ndarray, film: Film, size: np.ndarray) -> list[Callable[[int], None]]:
        links = np.asarray(self.links, dtype=int).reshape(-1, 2)
        is_spring = np.isin(np.arange(len(links)), self.springs) & (len(self.springs) <= _COILS) & (x.shape[2] == 2)
        movers: list[Callable[[int], None]] = []
        for some, shape in ((~is_spring, None), (is_spring, partial(coils, width=0.05 * size.max()))):
            numbers = np.flatnonzero(some)
            if numbers.size:
                lines = draw.lines(color="0.35", linewidth=1.2 if len(links) <= _SIZES[1][0] else 0.4)
                ends = x[:, links[numbers]]
                shown = self._whole(numbers, film) & self._is_inside(ends) & np.isfinite(ends).all(axis=(2, 3))
                movers.append(partial(_move_links, lines, x, links[numbers], shown, shape))
        return movers

    def _is_inside(self, ends: np.ndarray) -> Any:
        """Return whether each link stays inside the periodic box, for its ends of the shape (frames, links, 2, ...)."""
        sides = np.asarray(self.box, dtype=float)
        some = np.flatnonzero(sides > 0)
        return (np.abs(ends[:, :, 1] - ends[:, :, 0])[..., some] < sides[some] / 2).all(axis=2)

    def _whole(self, numbers: np.ndarray, film: Film) -> np.ndarray:
        """Return whether each link is unbroken in each frame, shape (frames, links)."""
        shown = np.ones((len(film.t), numbers.size), dtype=bool)
        strings = dict(self.strings)
        for k, number in enumerate(numbers.tolist()):
            if number in strings:
                shown[:, k] = film.u[:, strings[number]] == 0
        return shown


def _trails(draw: Any, paths: list[np.ndarray], film: Film) -> list[Callable[[int], None]]:
    movers: list[Callable[[int], None]] = []
    for k, path in enumerate(paths):
        for seconds, style in ((np.inf, {"linewidth": 0.5, "alpha": 0.4}), (_TRAIL, {"linewidth": 1.4})):
            line = draw.line(color=f"C{k}", **style)
            movers.append(partial(_move_trail, draw, line, path, film, seconds))
    return movers


def _move_points(move: Callable[[np.ndarray], None], x: np.ndarray, i: int) -> None:
    move(x[i])


def _move_trail(draw: Any, line: Any, x: np.ndarray, film: Film, seconds: float, i: int) -> None:
    draw.move(line, x[film.rows(i, seconds)])


def _move_links(lines: Any, x: np.ndarray, links: np.ndarray, shown: np.ndarray, shape: Any, i: int) -> None:
    a, b = (x[i, links[shown[i], end]] for end in (0, 1))
    lines.set_segments(np.stack([a, b], axis=1) if shape is None else shape(a, b))


def _with_margin(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a box with a margin, which in space is nowhere thin."""
    margin = _MARGIN * ((high - low).max() or 1.0)
    low, high = low - margin, high + margin
    if low.size == 2:
        return low, high
    middle, half = (low + high) / 2, np.maximum(high - low, _LEAST * (high - low).max()) / 2
    return middle - half, middle + half


def _inside(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the places without the ones outside the limits, which axes in space do not clip: they are not a number."""
    is_inside = ((x >= low) & (x <= high)).all(axis=-1, keepdims=True)
    return x if is_inside.all() else np.where(is_inside, x, np.nan)
