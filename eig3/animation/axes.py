"""Draw points, lines and polygons on axes of matplotlib, in the plane and in space, true to scale."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .frames import Color
from .shapes import cut

_SHAPE = 1.35  # ratio of the width of the axes to their height
_CORNERS, _FEW_CORNERS = 32, 8  # corners of the outline of a ball in space; of a ball among many
_MANY = 1000  # balls or discs, which are too small for a dark outline; faces that are drawn together
_SIDES = 24  # of a disc among many; their distance from the circle is 1 % of its radius
_LIGHT = np.array([0.6, -0.64, 0.48])  # direction of the light on faces in space
_FACE = np.array([0.35, 0.62, 0.9])  # colour of a face perpendicular to the light
_DARK = 0.2, 0.55  # brightness of a face along the light: of one colour, and of a face whose colour is a value
_OUTLINE = 0.2  # grey
_OPACITY = 0.8  # of discs


@dataclass(frozen=True, eq=False)
class Tints:
    """The colours of values, shape (frames, k), on a scale, a ScalarMappable of matplotlib."""

    values: np.ndarray
    scale: Any

    def __call__(self, i: int) -> np.ndarray:
        """Return red, green and blue in frame i, shape (k, 3)."""
        return np.asarray(self.scale.to_rgba(self.values[i])[:, :3])


@dataclass(frozen=True, eq=False)
class Faces:
    """Polygons, with `corners` of the shape (frames, faces, corners, 2 or 3)."""

    corners: np.ndarray
    opacity: float = 1.0
    tints: Tints | None = None


@dataclass(frozen=True, eq=False)
class Discs:
    """Discs or balls, with `centres` of the shape (frames, discs, 2 or 3)."""

    centres: np.ndarray
    radii: np.ndarray
    color: str
    tints: Tints | None = None

    def faces(self, i: int) -> np.ndarray:
        """Return the colours in frame i, shape (discs, 4)."""
        from matplotlib.colors import to_rgba

        if self.tints is None:
            return np.tile(to_rgba(self.color, _OPACITY), (self.radii.size, 1))
        return _opaque(self.tints(i), 1.0)


def scale_of(figure: Any, axes: Any, color: Color, some: Any) -> Any:
    """Add a scale of colours for the values of some points, and return what maps values to colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(*color.range(some)), "viridis")
    name = "" if color.name == "color" else color.name
    figure.colorbar(scale, ax=axes, shrink=0.8, label=f"{name} ({color.unit})" if color.unit else name)
    return scale


def axes_of(
    figure: Any, low: np.ndarray, high: np.ndarray, labels: Sequence[str], note: str, camera: Any, *, is_exact: bool
) -> Any:
    """Add axes with equal scales and limits that contain the box, or are the box if `is_exact`."""
    if low.size == 2:
        axes = figure.add_subplot()
        width, height = high - low
        spare = np.maximum(0, [_SHAPE * height - width, width / _SHAPE - height]) / 2  # fills the picture
        spare = spare * (not is_exact)
        axes.set(xlim=(low[0] - spare[0], high[0] + spare[0]), ylim=(low[1] - spare[1], high[1] + spare[1]))
        axes.set_aspect("equal")
    else:
        azimuth, elevation, distance = camera or (-60.0, 30.0, 1.0)
        axes = figure.add_subplot(projection="3d", azim=azimuth, elev=elevation)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        is_low = high[2] - low[2] < 0.7 * (high - low).max() and camera is None
        axes.set_box_aspect(high - low, zoom=0.95 if is_low else 0.83 / distance)
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


class Plane:
    """Drawing in two dimensions."""

    def __init__(self, axes: Any) -> None:
        self.axes = axes

    def line(self, **style: Any) -> Any:
        return self.axes.plot([], [], **style)[0]

    def move(self, line: Any, x: np.ndarray) -> None:
        line.set_data(*x.T)

    def dots(self, x: np.ndarray, size: float, tints: Tints) -> Callable[[int], None]:
        """Add dots with colours, at places of the shape (frames, dots, 2); return the function that shows a frame."""
        dots = self.axes.scatter(*x[0].T, s=size**2, zorder=3)
        return partial(_move, dots, dots.set_offsets, x, tints)

    def lines(self, **style: Any) -> Any:
        from matplotlib.collections import LineCollection

        return self.axes.add_collection(LineCollection([], zorder=2, **style), autolim=False)

    def polygons(self, faces: Sequence[Faces], discs: Sequence[Discs]) -> list[Callable[[int], None]]:
        """Add polygons and discs; return the functions that show a frame."""
        return [*map(self._faces, faces), *map(self._discs, discs)]

    def _discs(self, discs: Discs) -> Callable[[int], None]:
        from matplotlib.collections import EllipseCollection
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        radii, start = discs.radii, np.zeros((discs.radii.size, 2))
        outline = {"edgecolor": f"{_OUTLINE}", "linewidth": 0.6} if radii.size < _MANY else {"edgecolor": "none"}
        if radii.size >= _MANY and discs.tints is None:  # one path is drawn twice as fast as many
            angle = np.linspace(0, 2 * np.pi, _SIDES + 1)
            around = radii[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            codes = np.tile([Path.MOVETO] + [Path.LINETO] * _SIDES, radii.size)
            patch = PathPatch(Path(np.zeros((1, 2))), color=discs.color, alpha=_OPACITY, linewidth=0, zorder=2.5)
            self.axes.add_patch(patch)
            return lambda i: patch.set_path(Path((discs.centres[i][:, None] + around).reshape(-1, 2), codes))
        style: dict[str, Any] = {"facecolor": discs.color, "alpha": _OPACITY, **outline}
        shown = EllipseCollection(2 * radii, 2 * radii, 0 * radii, units="xy", offsets=start, zorder=2.5, **style)
        shown.set_offset_transform(self.axes.transData)
        self.axes.add_collection(shown, autolim=False)
        return partial(_move, shown, shown.set_offsets, discs.centres, discs.tints)

    def _faces(self, faces: Faces) -> Callable[[int], None]:
        from matplotlib.collections import PolyCollection

        style: dict[str, Any] = {"facecolor": _FACE, "edgecolor": "0.35", "linewidth": 0.4, "zorder": 1.5}
        shown = PolyCollection([], alpha=faces.opacity, **style)
        self.axes.add_collection(shown, autolim=False)
        return partial(_move, shown, shown.set_verts, faces.corners, faces.tints)

    def plane(self, normal: np.ndarray, offset: float, low: np.ndarray, high: np.ndarray) -> None:
        """Fill the blocked side, far beyond the limits of the axes."""
        middle = (low + high) / 2
        foot = middle + (offset - normal @ middle) * normal
        along, far = np.array([-normal[1], normal[0]]), 10 * (high - low).max()
        ends = foot - far * along, foot + far * along
        self.axes.fill(*np.array([*ends, ends[1] - far * normal, ends[0] - far * normal]).T, color="0.88", zorder=0)
        self.axes.plot(*np.array(ends).T, color="0.35", linewidth=1, zorder=1)


def _move(shown: Any, place: Callable[[np.ndarray], None], x: np.ndarray, tints: Tints | None, i: int) -> None:
    place(x[i])
    if tints is not None:
        shown.set_facecolor(tints(i))


class Space:
    """Drawing in three dimensions."""

    def __init__(self, axes: Any) -> None:
        self.axes = axes

    def line(self, **style: Any) -> Any:
        return self.axes.plot([], [], [], **style)[0]

    def move(self, line: Any, x: np.ndarray) -> None:
        line.set_data_3d(*x.T)

    def dots(self, x: np.ndarray, size: float, tints: Tints) -> Callable[[int], None]:
        """Add dots with colours, at places of the shape (frames, dots, 3); return the function that shows a frame."""
        dots = self.axes.scatter(*x[0].T, s=size**2, zorder=3, depthshade=False)
        return partial(_move, dots, lambda now: setattr(dots, "_offsets3d", tuple(now.T)), x, tints)

    def lines(self, **style: Any) -> Any:
        from mpl_toolkits.mplot3d.art3d import Line3DCollection

        return self.axes.add_collection3d(Line3DCollection(np.zeros((1, 2, 3)), **style))

    def polygons(self, faces: Sequence[Faces], discs: Sequence[Discs]) -> list[Callable[[int], None]]:
        """Add polygons and balls, of which the nearer ones cover the others; return the functions that show a frame."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        if not faces and not discs:
            return []
        self.axes.computed_zorder = False  # a large plane would otherwise cover objects on it
        if not discs and len(faces) == 1 and faces[0].corners.shape[1] >= _MANY and faces[0].opacity == 1:
            from .many_faces import ManyFaces

            surface = ManyFaces(self.axes)
            return [lambda i: surface.move(faces[0].corners[i], _lit(faces[0], i))]
        is_large = sum(each.radii.size for each in discs) < _MANY
        style = {"linewidth": 0.6 if is_large else 0.1} if discs else {"linewidth": 0, "antialiased": False}
        outlines = [self._outline(each.radii, _CORNERS if is_large else _FEW_CORNERS) for each in discs]
        count = max([each.corners.shape[2] for each in faces] + [outline.shape[1] for outline in outlines])
        shown = Poly3DCollection(np.zeros((1, 3, 3)), zorder=1.5, **style)
        self.axes.add_collection3d(shown)

        def move(i: int) -> None:
            balls = [each.centres[i][:, None] + outline for each, outline in zip(discs, outlines, strict=True)]
            corners = np.concatenate([_with_corners(x, count) for x in (*(each.corners[i] for each in faces), *balls)])
            of_faces, of_balls = [_lit(each, i) for each in faces], [each.faces(i) for each in discs]
            edges = [*of_faces, *(np.tile(_opaque(3 * [_OUTLINE], 1.0), (len(x), 1)) for x in of_balls)]
            is_known = np.isfinite(corners).all(axis=(1, 2))  # what is outside the limits has no place
            shown.set_verts(corners[is_known])
            shown.set_facecolor(np.concatenate([*of_faces, *of_balls])[is_known])
            shown.set_edgecolor(np.concatenate(edges)[is_known])

        return [move]

    def _outline(self, radii: np.ndarray, corners: int) -> np.ndarray:
        """Return the outlines of balls around 0, as polygons normal to the line of sight."""
        azimuth, elevation = np.radians([self.axes.azim, self.axes.elev])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        sight = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)[:, None]
        return np.asarray(
            radii[:, None, None] * (np.cos(angle) * right + np.sin(angle) * np.cross(sight, right)), dtype=float
        )

    def plane(self, normal: np.ndarray, offset: float, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the part of the plane inside the box."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        cuts = cut(normal, offset, low, high)
        if not len(cuts):
            return
        patch = Poly3DCollection([cuts], facecolor="0.8", alpha=0.5, zorder=0)
        self.axes.add_collection3d(patch)


def _lit(faces: Faces, i: int) -> np.ndarray:
    """Return the colours of faces, which are darker where they turn from the light, shape (faces, 4)."""
    x = faces.corners[i]
    normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    light = np.abs(normals @ _LIGHT) / np.linalg.norm(normals, axis=-1)
    color, dark = (_FACE, _DARK[0]) if faces.tints is None else (faces.tints(i), _DARK[1])
    return _opaque((dark + (1 - dark) * light[:, None]) * color, faces.opacity)


def _opaque(color: Any, opacity: float) -> np.ndarray:
    """Return colours with their opacity as the fourth component."""
    color = np.asarray(color)
    return np.concatenate([color, np.full_like(color[..., :1], opacity)], axis=-1)


def _with_corners(x: np.ndarray, count: int) -> np.ndarray:
    """Return polygons, shape (k, corners, 3), with `count` corners: the last one is repeated."""
    return x if x.shape[1] == count else np.concatenate([x, np.repeat(x[:, -1:], count - x.shape[1], axis=1)], axis=1)
