"""Draw the frames of a figure in which few artists move: what stays behind them is drawn once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


class Redraw:
    """Draws frames with the same pixels as the whole figure, which has a canvas of Agg.

    ``show(i)`` moves the artists to frame i, and `last` is the number of the last frame. What differs in it from the
    first frame moves.
    """

    def __init__(self, figure: Any, show: Callable[[int], None], last: int) -> None:
        self.figure, self.show = figure, show
        figure.canvas.draw()
        _settle(figure.findobj())
        show(last)
        self.behind, front = _layers(figure)
        _set_visible(front, False)
        figure.canvas.draw()
        self.background = figure.canvas.copy_from_bbox(figure.bbox)
        _set_visible(front, True)
        self.parts = [part for artist in self.behind for part in _parts(artist)]
        self.places = _places(figure)
        _settle(self.parts)

    def __call__(self, i: int) -> np.ndarray:
        """Return the pixels of frame i, shape (height, width, 3)."""
        self.show(i)
        canvas = self.figure.canvas
        if self._stays():
            canvas.restore_region(self.background)
            _set_visible(self.behind, False)
            self.figure.draw(canvas.renderer)
            _set_visible(self.behind, True)
            _settle(self.parts)
        if not self._stays():
            self.background = None
            canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3]

    def _stays(self) -> bool:
        """Return whether the figure still has this background; the places are known after a drawing."""
        is_stale = self.background is None or any(part.stale for part in self.parts)
        return not is_stale and _places(self.figure) == self.places


def _layers(figure: Any) -> tuple[list[Any], list[Any]]:
    """Return what is drawn before the first part of its axes that has moved, and the rest, without what is hidden."""
    behind: list[Any] = [figure.patch]
    front: list[Any] = []
    for part in figure.get_children():
        if part is not figure.patch and part not in figure.axes:  # such as a caption, which nothing covers
            (front if _may_move(part) else behind).append(part)
    for axes in figure.axes:
        parts = [part for part in axes.get_children() if part is not axes.patch]
        if _is_space(axes):  # the axis is drawn before all other parts, whose order may change
            behind.append(axes)
            count, parts = 0, [part for part in parts if part not in axes._axis_map.values()]
        else:
            parts.sort(key=lambda part: part.zorder)
            count = next((k for k, part in enumerate(parts) if _may_move(part)), len(parts))
            if axes.xaxis not in parts[:count] or axes.yaxis not in parts[:count]:
                count = 0  # other limits would move all parts
        behind += [axes.patch, *parts[:count]]
        front += parts[count:]
    return [part for part in behind if part.get_visible()], [part for part in front if part.get_visible()]


def _may_move(artist: Any) -> bool:
    return not artist.get_visible() or any(part.stale for part in artist.findobj())


def _is_space(artist: Any) -> bool:
    return getattr(artist, "name", "") == "3d"


def _parts(artist: Any) -> list[Any]:
    """Return an artist and all within it; for axes in space, their axis alone."""
    inner = artist._axis_map.values() if _is_space(artist) else [artist]
    return [part for each in inner for part in each.findobj()]


def _set_visible(artists: Sequence[Any], visible: bool) -> None:
    for artist in artists:
        if not _is_space(artist):
            artist.set_visible(visible)
        elif visible:
            artist.set_axis_on()
        else:
            artist.set_axis_off()


def _places(figure: Any) -> list[Any]:
    """Return the place of each axes, the number of its parts, and in space the direction of view."""
    places = [(axes.get_position().bounds, len(axes.get_children())) for axes in figure.axes]
    return [*places, *(axes.get_proj().tolist() for axes in figure.axes if _is_space(axes))]


def _settle(artists: Sequence[Any]) -> None:
    for artist in artists:
        artist.stale = False
