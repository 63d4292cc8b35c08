"""Many triangles in space that are drawn together, which takes a third of the time of matplotlib's polygons."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.transforms import IdentityTransform
from mpl_toolkits.mplot3d.proj3d import proj_transform


class ManyFaces(Artist):
    """Polygons in space, each with one colour, as triangles of which the nearer ones cover the others."""

    def __init__(self, axes: Any) -> None:
        super().__init__()
        self.corners, self.colors = np.empty((0, 3, 3)), np.empty((0, 4))
        self.set_zorder(1.5)
        axes.add_artist(self)

    def move(self, corners: np.ndarray, colors: np.ndarray) -> None:
        """Show convex polygons, shape (k, corners, 3), with their colours, shape (k, 4); not a number hides one."""
        fans = [[0, j, j + 1] for j in range(1, corners.shape[1] - 1)]
        self.corners, self.colors = corners[:, fans].reshape(-1, 3, 3), np.repeat(colors, len(fans), axis=0)
        self.stale = True

    def draw(self, renderer: Any) -> None:
        if not self.get_visible():
            return
        x, y, depth = np.reshape(proj_transform(*self.corners.reshape(-1, 3).T, self.axes.M), (3, -1, 3))
        far_first = np.argsort(-depth.mean(axis=1))
        far_first = far_first[np.isfinite(depth.mean(axis=1))[far_first]]
        places = self.axes.transData.transform(np.stack([x, y], axis=-1)[far_first].reshape(-1, 2))
        colors = np.repeat(self.colors[far_first, None], 3, axis=1)
        context = renderer.new_gc()
        context.set_clip_rectangle(self.clipbox)
        renderer.draw_gouraud_triangles(context, places.reshape(-1, 3, 2), colors, IdentityTransform())
        context.restore()
        self.stale = False
