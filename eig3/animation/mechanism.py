"""A view of points, links, faces, supports and planes, in the plane and in space, true to scale."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..geometry import Geometry
from .film import Film, Places
from .shapes import Solid, coils, cut, edges_of_box, main_part, surface, wrapped

_COILS = 40  # more springs than this are drawn as lines
_MARGIN = 0.08  # around the motion, relative to its size
_SHAPE = 1.35  # ratio of the width of the axes to their height
_LEAST = 0.5  # least side of the box in space, relative to its longest side
_TRAIL = 0.7  # seconds of the film
_CORNERS, _FEW_CORNERS = 32, 8  # corners of the outline of a ball in space; of a ball among many
_MANY = 1000  # balls or discs, which are too small for a dark outline
_FEW = 50  # points: with more, those that fly far away do not scale the picture
_CLEAR = 0.5  # opacity of bodies in space with links, which end within them
_LIGHT = np.array([0.6, -0.64, 0.48])  # direction of the light on faces in space
_FACE = np.array([0.35, 0.62, 0.9])  # colour of a face perpendicular to the light
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
class Mechanism:
    """Moving points, links and faces between them, supports and planes.

    Attributes
    ----------
    places : callable
        ``places(t, u)`` returns the places of all points at the times t, shape (m,), for the displacements u, shape
        (m, n): an array of shape (m, points, 2) or (m, points, 3), m.
    links : sequence of (int, int)
        The numbers of the points at the ends of each link.
    springs : sequence of int
        The numbers of the links that are drawn as springs.
    strings : dict of int to int
        For the number of each breakable link, the degree of freedom that differs from 0 once it is broken.
    faces : array_like of int, shape (faces, corners)
        The numbers of the corners of each face of a surface. In space faces are shaded by their direction to the light.
    hidden : sequence of int
        The numbers of the points that are not drawn, such as the points of a surface.
    fixed : sequence of int
        The numbers of the points that are supports.
    planes : sequence of (normal, offset)
        Planes normal . x = offset, whose normal points to the free side.
    radii : sequence of float
        The radius of each point, m: a point with a radius is drawn as a disc, or in space as a ball. Without radii, or
        with 0, it is a dot.
    trails : sequence of int
        The numbers of the points with a trail.
    marks : sequence of (place, style, size, name)
        Static marks, such as the sun, with a format string of matplotlib as style, such as "C1o".
    labels : tuple of str
        Labels of the axes; an axis without a label has no scale.
    note : str
        A line below the picture, such as how much the displacements are magnified.
    box : sequence of float
        The sides of a periodic box with a corner at the origin; 0 along an axis that is not periodic. Empty without it.
    shear : float
        The rate at which the box shears, 1/s: see `Scene`.
    solids : sequence of Solid
        The shapes of rigid bodies.
    """

    places: Places
    links: Any = ()
    springs: Any = ()
    strings: Any = ()
    faces: Any = ()
    hidden: Any = ()
    fixed: Any = ()
    planes: Any = ()
    radii: Any = ()
    trails: Any = ()
    marks: Any = ()
    labels: tuple[str, ...] = ("x (m)", "y (m)", "z (m)")
    note: str = ""
    box: Any = ()
    shear: float = 0.0
    solids: Any = ()

    @property
    def geometry(self) -> Geometry:
        """The points, the links and the triangles of the faces, without velocities and masses."""
        faces = np.asarray(self.faces)
        cells = [faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)] if len(faces) else []
        given = {name: getattr(self, name) for name in ("places", "links", "strings", "fixed", "radii")}
        return Geometry(cells=cells, **given)

    def __call__(self, figure: Any, film: Film) -> Callable[[int], None]:
        x = self.places(film.t, film.u.reshape(len(film.t), -1))
        if len(self.box):
            x = wrapped(x, film.t, self.box, self.shear)
        paths = self._paths(film)
        radii = np.asarray(self.radii, dtype=float) if len(self.radii) else np.zeros(x.shape[1])
        discs = np.flatnonzero(radii > 0)
        around = radii[discs, None]
        surfaces = [surface(solid, x) for solid in self._drawn]
        corners = [each.reshape(-1, x.shape[2]) for each in surfaces]
        ends = [point for solid in self.solids for point in solid.points[1:]]
        low, high = self._limits(
            [*np.delete(x, ends, axis=1), *paths, *(x[:, discs] - around), *(x[:, discs] + around), *corners]
        )
        axes = _axes_of(figure, low, high, self.labels, self.note)
        draw = _Space(axes) if x.shape[2] == 3 else _Plane(axes)
        for normal, offset in self.planes:
            draw.plane(np.asarray(normal, dtype=float), float(offset), low, high)
        if len(self.box):
            draw.lines(color="0.6", linewidth=0.8).set_segments(edges_of_box(*self._sides(low, high)))
        for place, style, width, name in self.marks:
            axes.plot(*np.reshape(place, (-1, 1)), style, markersize=width)
            axes.text(*place, f"\n{name}", ha="center", va="top", linespacing=0.8)
        movers = [*_trails(draw, paths, film), *self._links(draw, x, film, high - low)]
        if len(self.faces):
            movers.append(partial(_move_points, draw.faces(), x[:, np.asarray(self.faces)]))
        for count in sorted({each.shape[2] for each in surfaces}):
            some = np.concatenate([each for each in surfaces if each.shape[2] == count], axis=1)
            movers.append(partial(_move_points, draw.faces(_CLEAR if len(self.links) else 1.0), some))
        movers += self._points(draw, x, radii)

        def show(i: int) -> None:
            for move in movers:
                move(i)

        return show

    @property
    def _drawn(self) -> list[Solid]:
        """The solids that are drawn: links show the other bodies."""
        linked = set(np.ravel(self.links).tolist())
        return [solid for solid in self.solids if solid.is_given or solid.points[0] not in linked]

    def _points(self, draw: Any, x: np.ndarray, radii: np.ndarray) -> Iterator[Callable[[int], None]]:
        """Draw the points, and yield the functions that move them."""
        numbers = np.arange(x.shape[1])
        is_fixed: Any = np.isin(numbers, self.fixed)
        for is_some, color in ((is_fixed, "0.5"), (~is_fixed, "C0")):
            some = np.flatnonzero(is_some & (radii > 0))
            if some.size:
                yield partial(_move_points, draw.discs(radii[some], color), x[:, some])
        size = next((size for most, size in _SIZES if x.shape[1] <= most), 1.5)
        centres = [solid.points[0] for solid in self._drawn]
        is_dot = (radii == 0) & ~np.isin(numbers, [*self.hidden, *centres])
        for some, style in ((is_dot & is_fixed, ("k", "^")), (is_dot & ~is_fixed, ("C0", "o"))):
            if some.any():
                dots = draw.line(linestyle="none", markersize=size, zorder=3, color=style[0], marker=style[1])
                yield partial(_move_points, partial(draw.move, dots), x[:, some])

    def _paths(self, film: Film) -> list[np.ndarray]:
        """Return the path of each point with a trail, shape (times, 2 or 3)."""
        trails = list(self.trails)
        if not trails or len(self.box):
            return []
        return list(np.moveaxis(film.path(lambda t, u: self.places(t, u.reshape(len(t), -1))[:, trails]), 1, 0))

    def _limits(self, places: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return two corners of a box that contains the marks and the positions, arrays of shape (points, 2 or 3)."""
        shown = np.concatenate([*places, *([place] for place, *_ in self.marks)])
        low, high = shown.min(axis=0), shown.max(axis=0)
        if len(places[0]) > _FEW:
            low, high = main_part(shown, low, high)
        if len(self.box):
            low, high = self._sides(low, high)
        margin = _MARGIN * ((high - low).max() or 1.0)
        low, high = low - margin, high + margin
        if low.size == 2:
            return low, high
        middle, half = (low + high) / 2, np.maximum(high - low, _LEAST * (high - low).max()) / 2
        return middle - half, middle + half

    def _sides(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return two corners of the periodic box, which reaches from low to high along axes that are not periodic."""
        sides = np.asarray(self.box, dtype=float)
        return np.where(sides > 0, 0.0, low), np.where(sides > 0, sides, high)

    def _links(self, draw: Any, x: np.ndarray, film: Film, size: np.ndarray) -> list[Callable[[int], None]]:
        links = np.asarray(self.links, dtype=int).reshape(-1, 2)
        is_spring = np.isin(np.arange(len(links)), self.springs) & (len(self.springs) <= _COILS) & (x.shape[2] == 2)
        movers: list[Callable[[int], None]] = []
        for some, shape in ((~is_spring, None), (is_spring, partial(coils, width=0.05 * size.max()))):
            numbers = np.flatnonzero(some)
            if numbers.size:
                lines = draw.lines(color="0.35", linewidth=1.2 if len(links) <= _SIZES[1][0] else 0.4)
                shown = self._whole(numbers, film) & self._is_inside(x[:, links[numbers]])
                movers.append(partial(_move_links, draw, lines, x, links[numbers], shown, shape))
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


def _move_links(draw: Any, lines: Any, x: np.ndarray, links: np.ndarray, shown: np.ndarray, shape: Any, i: int) -> None:
    a, b = (x[i, links[shown[i], end]] for end in (0, 1))
    lines.set_segments(np.stack([a, b], axis=1) if shape is None else shape(a, b))


def _axes_of(figure: Any, low: np.ndarray, high: np.ndarray, labels: tuple[str, ...], note: str) -> Any:
    """Add axes with equal scales and limits that contain the box."""
    if low.size == 2:
        axes = figure.add_subplot()
        width, height = high - low
        spare = np.maximum(0, [_SHAPE * height - width, width / _SHAPE - height]) / 2  # fills the picture
        axes.set(xlim=(low[0] - spare[0], high[0] + spare[0]), ylim=(low[1] - spare[1], high[1] + spare[1]))
        axes.set_aspect("equal")
    else:
        axes = figure.add_subplot(projection="3d")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low, zoom=0.95 if high[2] - low[2] < 0.7 * (high - low).max() else 0.83)
    axes.autoscale(False)
    for direction, label in zip("xyz"[: low.size], labels, strict=False):
        axis = getattr(axes, f"{direction}axis")
        axis.set_label_text(label)
        axes.locator_params(axis=direction, nbins=5 if low.size == 2 else 3)
        if not label:
            axis.set_ticks([])
    if note:
        figure.supxlabel(note, fontsize="medium", color="0.35")
    return axes


class _Plane:
    """Drawing in two dimensions."""

    def __init__(self, axes: Any) -> None:
        self.axes = axes

    def line(self, **style: Any) -> Any:
        return self.axes.plot([], [], **style)[0]

    def move(self, line: Any, x: np.ndarray) -> None:
        line.set_data(*x.T)

    def lines(self, **style: Any) -> Any:
        from matplotlib.collections import LineCollection

        return self.axes.add_collection(LineCollection([], zorder=2, **style), autolim=False)

    def discs(self, radii: np.ndarray, color: str) -> Callable[[np.ndarray], None]:
        """Add discs; return the function that moves their centres."""
        from matplotlib.collections import EllipseCollection

        style: dict[str, Any] = {"facecolor": color, "edgecolor": "0.2", "alpha": 0.8}
        style["linewidth"] = 0.6 if radii.size < _MANY else 0.1
        discs = EllipseCollection(
            2 * radii, 2 * radii, 0 * radii, units="xy", offsets=np.zeros((radii.size, 2)), zorder=2.5, **style
        )
        discs.set_offset_transform(self.axes.transData)
        return self.axes.add_collection(discs, autolim=False).set_offsets

    def faces(self, alpha: float = 1.0) -> Callable[[np.ndarray], None]:
        """Add a surface; return the function that moves the corners of its faces."""
        from matplotlib.collections import PolyCollection

        faces = PolyCollection([], alpha=alpha, facecolor=_FACE, edgecolor="0.35", linewidth=0.4, zorder=1.5)
        return self.axes.add_collection(faces, autolim=False).set_verts

    def plane(self, normal: np.ndarray, offset: float, low: np.ndarray, high: np.ndarray) -> None:
        """Fill the blocked side, far beyond the limits of the axes."""
        middle = (low + high) / 2
        foot = middle + (offset - normal @ middle) * normal
        along, far = np.array([-normal[1], normal[0]]), 10 * (high - low).max()
        ends = foot - far * along, foot + far * along
        self.axes.fill(*np.array([*ends, ends[1] - far * normal, ends[0] - far * normal]).T, color="0.88", zorder=0)
        self.axes.plot(*np.array(ends).T, color="0.35", linewidth=1, zorder=1)


class _Space:
    """Drawing in three dimensions."""

    def __init__(self, axes: Any) -> None:
        self.axes = axes

    def line(self, **style: Any) -> Any:
        return self.axes.plot([], [], [], **style)[0]

    def move(self, line: Any, x: np.ndarray) -> None:
        line.set_data_3d(*x.T)

    def lines(self, **style: Any) -> Any:
        from mpl_toolkits.mplot3d.art3d import Line3DCollection

        return self.axes.add_collection3d(Line3DCollection(np.zeros((1, 2, 3)), **style))

    def discs(self, radii: np.ndarray, color: str) -> Callable[[np.ndarray], None]:
        """Add the outlines of balls, as polygons normal to the line of sight; return the function that moves them."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        azimuth, elevation = np.radians([self.axes.azim, self.axes.elev])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        sight = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        corners, width = (_CORNERS, 0.6) if radii.size < _MANY else (_FEW_CORNERS, 0.1)
        angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)[:, None]
        outline = radii[:, None, None] * (np.cos(angle) * right + np.sin(angle) * np.cross(sight, right))
        discs = Poly3DCollection(outline, facecolor=color, edgecolor="0.2", linewidth=width, alpha=0.8, zorder=1.5)
        self.axes.add_collection3d(discs)
        self.axes.computed_zorder = False  # a large plane would otherwise cover objects on it
        return lambda x: discs.set_verts(x[:, None] + outline)

    def faces(self, alpha: float = 1.0) -> Callable[[np.ndarray], None]:
        """Add a surface; return the function that moves the corners of its faces."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        faces = Poly3DCollection(np.zeros((1, 3, 3)), linewidth=0, antialiased=False, zorder=1.5)
        self.axes.add_collection3d(faces)
        self.axes.computed_zorder = False  # as for discs

        def move(corners: np.ndarray) -> None:
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            light = np.abs(normals @ _LIGHT) / np.linalg.norm(normals, axis=-1)
            faces.set_verts(corners)
            faces.set_facecolor(np.column_stack([(0.2 + 0.8 * light[:, None]) * _FACE, np.full(len(light), alpha)]))

        return move

    def plane(self, normal: np.ndarray, offset: float, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the part of the plane inside the box."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        cuts = cut(normal, offset, low, high)
        if not len(cuts):
            return
        patch = Poly3DCollection([cuts], facecolor="0.8", alpha=0.5, zorder=0)
        self.axes.add_collection3d(patch)
