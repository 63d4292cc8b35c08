"""Loads of a structure that are given as records: forces on some degrees of freedom, and motions of the ground."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..functions.checks import reals, shown


def check_ground(ground: Any, n: int) -> dict[str, Any]:
    """Return the parameters of a motion of the ground: times, accelerations and influences.

    Raises
    ------
    TypeError, ValueError
        If it is not (times, accelerations) or (times, accelerations, influence), or they do not fit.
    """
    if not (isinstance(ground, tuple) and len(ground) in (2, 3)):
        raise TypeError(
            f"ground must be (times, accelerations) or (times, accelerations, influence), not {shown(ground)}."
        )
    times, values = _record(ground[0], ground[1], "ground")
    if values.ndim != 1:
        raise ValueError(f"ground must have one acceleration for each time, not values of the shape {values.shape}.")
    influence = reals(ground[2], "the influence of ground") if len(ground) == 3 else np.ones(n)
    if influence.shape != (n,) or not np.isfinite(influence).all():
        raise ValueError(f"the influence of ground must be {n} finite numbers, not of the shape {influence.shape}.")
    return {"ground_times": times, "ground": values, "influence": influence, "ground_scale": 1.0}


def check_table(force: Any, n: int) -> dict[str, Any]:
    """Return the parameters of forces given by a table: times, forces and their degrees of freedom.

    Raises
    ------
    TypeError, ValueError
        If it is not (times, forces) or (times, forces, degrees), or they do not fit.
    """
    if not (isinstance(force, tuple) and len(force) in (2, 3)):
        raise TypeError(
            "force must be a jitted function f(t, u, v, p, out), or a table (times, forces) or (times, forces, "
            f"degrees), not {shown(force)}."
        )
    times, values = _record(force[0], force[1], "force")
    degrees = np.arange(n) if len(force) == 2 else np.atleast_1d(np.asarray(force[2]))
    values = values[:, None] if values.ndim == 1 else values
    if degrees.dtype.kind not in "ui" or degrees.ndim != 1 or not ((degrees >= 0) & (degrees < n)).all():
        raise ValueError(f"the degrees of force must be whole numbers from 0 to {n - 1}.")
    if values.ndim != 2 or values.shape[1] != degrees.size:
        raise ValueError(
            f"force must have {degrees.size} values for each time, not values of the shape {values.shape}."
        )
    return {"force_times": times, "forces": values, "degrees": degrees.astype(np.int64), "force_scale": 1.0}


def _record(times: Any, values: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    t, x = reals(times, f"the times of {name}"), reals(values, name)
    if t.ndim != 1 or t.size < 2 or not (np.isfinite(t).all() and (np.diff(t) > 0).all()):
        raise ValueError(f"the times of {name} must be two or more finite numbers that increase.")
    if x.ndim == 0 or len(x) != t.size or not np.isfinite(x).all():
        raise ValueError(f"{name} must have a finite value for each of its {t.size} times.")
    return t, x
