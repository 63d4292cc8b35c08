"""Find out whether an angle from -pi to pi, which a torque depends on, passes half a turn in a run."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..functions.callbacks import check_callback
from ..functions.companions import Angles
from ..functions.evaluation import accelerations
from ..kernels.protocol import VECTOR

TURNED = 0.05  # a smaller change of all unit vectors, about 3 degrees, is a vibration: no angle is computed
_NEAR = 0.5  # a larger change of a unit vector from one saved state to the next may be any angle
_VALUES = 2**18  # of states that are looked at together


def half_turns(angles: Angles, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> Iterator[str]:
    """Describe each angle that passes half a turn between two saved states, which have the shape (m, n)."""
    count = max(1, _VALUES // u.shape[1])
    parts = [slice(first, first + count + 1) for first in range(0, len(u) - 1, count)]
    parts = [rows for rows in parts if np.abs(u[rows][:, angles.degrees] - u[0, angles.degrees]).max() > TURNED]
    if not parts:
        return
    callback, found = check_callback(angles.function, "rhs", VECTOR, "angles"), set()
    for rows in parts:
        values = accelerations(callback, params, t[rows], u[rows], v[rows], len(angles.names))
        is_near = np.abs(np.diff(u[rows][:, angles.degrees], axis=0)).max(axis=1) < _NEAR
        jumps = (np.abs(np.diff(values, axis=0)) > math.pi) & is_near[:, None]
        for k in np.flatnonzero(jumps.any(axis=0)).tolist():
            if k not in found:
                found.add(k)
                yield (
                    f"The angle of {angles.names[k]} passes half a turn after t = {t[rows][jumps[:, k].argmax()]:.4g}. "
                    "It is from -pi to pi, so the torque jumps there. For a torque that depends on whole turns, take a "
                    "Link whose state is the angle: its state_rate returns rate, and its tension reads state in place "
                    "of r."
                )
