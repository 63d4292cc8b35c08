"""Finite blow-ups: whether a motion has grown beyond what can be meant, without looking at any invariant."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..stepper import Stepper
from .chunk import Chunk

_STRANGE = 1e3  # times its natural size: where an instability may have begun
_BLOWN_UP = 1e4  # times its natural size: where it is worth finding out whether there is one
_OVERFLOWING = 1e100


class Growth:
    """The size of the motion at the ends of chunks, in units of its natural size.

    The natural size of v is the largest |v| at the start and what the acceleration at the start could add to it in the
    whole span; that of u is found from |u| and that v in the same way. A motion that starts at rest without any
    acceleration has the size that it reaches in half of the span.
    """

    def __init__(self, stepper: Stepper, n_steps: int) -> None:
        span = n_steps * stepper.h
        self._half = n_steps // 2
        u, v = stepper.start
        v_size = _largest(v) + span * _largest(stepper.first_acceleration)
        self._natural = _largest(u) + span * v_size, v_size
        self._strange: Stepper | None = None
        self._size, self._is_overflowing = 0.0, False

    @property
    def needs_half(self) -> bool:
        """Whether a chunk should end in the middle of the run."""
        return self._natural[1] == 0

    def see(self, chunk: Chunk) -> None:
        stepper = chunk.stepper
        u, v = _largest(stepper.u), _largest(stepper.v)
        if self._natural[1] == 0 and stepper.index >= self._half > chunk.first:
            self._natural = u, v
        u_natural, v_natural = self._natural
        self._size = max(u / u_natural if u_natural else 0.0, v / v_natural if v_natural else 0.0)
        self._is_overflowing = max(u, v) > _OVERFLOWING
        if self._strange is None and self._size > _STRANGE:
            self._strange = stepper.before()

    @property
    def suspect(self) -> Stepper | None:
        """Where the run stood before the motion grew strangely; None where it has not grown beyond all measure."""
        return self._strange if self._size > _BLOWN_UP or self._is_overflowing else None


def _largest(x: Any) -> float:
    return abs(x) if type(x) is float else float(np.abs(x).max())
