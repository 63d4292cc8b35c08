"""Find out whether an angle from -pi to pi, which a torque depends on, passes half a turn in a run."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..functions.callbacks import check_callback
from ..functions.companions import Angles
from ..functions.evaluation import energies
from ..kernels.protocol import VECTOR

_TURNED = 0.05  # a smaller change of all unit vectors, about 3 degrees, is a vibration: no angle is computed
_ROWS = 2**14  # states that are looked at together


def half_turns(angles: Angles, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> Iterator[str]:
    """Describe each angle that passes half a turn between two saved states.

    Parameters
    ----------
    angles : Angles
    params : ndarray
    t : ndarray, shape (m,)
    u, v : ndarray, shape (m, n)
        The saved states.
    """
    parts = [slice(first, first + _ROWS + 1) for first in range(0, len(u) - 1, _ROWS)]
    parts = [rows for rows in parts if np.abs((u[rows] - u[0])[:, angles.degrees]).max() > _TURNED]
    for name, function in angles.functions.items() if parts else ():
        callback = check_callback(function, "invariant", VECTOR, name)
        for rows in parts:
            jumps = np.abs(np.diff(energies(callback, params, t[rows], u[rows], v[rows]))) > math.pi
            if jumps.any():
                yield (
                    f"The angle of {name} passes half a turn after t = {t[rows][jumps.argmax()]:.4g}. It is from -pi "
                    "to pi, so the torque jumps there. For a torque that depends on whole turns, take a Link whose "
                    "state is the angle: its state_rate returns rate, and its tension reads state in place of r."
                )
                break
