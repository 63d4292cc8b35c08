"""The geometry of a problem, for films, pages and files: its points, links, faces, bodies and periodic box."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from .mechanism import Mechanism


def geometry(view: Any, name: str, otherwise: str = "take problem.animate, which shows") -> Mechanism:
    """Return the geometry in the view of a problem; `name` is the name of the problem.

    An error says what shows degrees of freedom against time otherwise.

    Raises
    ------
    ValueError
        If the view has no geometry, such as a view of degrees of freedom against time.
    """
    if isinstance(view, partial):  # a view that draws more than its mechanism
        view = view.keywords.get("mechanism")
    if isinstance(view, Mechanism):
        return view
    raise ValueError(
        f"{name} has no geometry: set its view with problem.with_(view=eig3.animation.Mechanism(places, links=...)), "
        f"or {otherwise} degrees of freedom against time."
    )


def in_space(x: np.ndarray) -> np.ndarray:
    """Return positions, shape (..., 2 or 3), with z = 0 for points in a plane."""
    return x if x.shape[-1] == 3 else np.concatenate([x, np.zeros_like(x[..., :1])], axis=-1)


def triangles(faces: Any) -> np.ndarray:
    """Return the corners of triangles, shape (k, 3), that fill faces with 3 or more corners each."""
    if not len(faces):
        return np.empty((0, 3), dtype=int)
    faces = np.asarray(faces, dtype=int)
    fans = [faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)]
    return np.stack(fans, axis=1).reshape(-1, 3)
