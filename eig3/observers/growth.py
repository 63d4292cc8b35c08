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
        u, v = stepper.u, stepper.v
        with np.errstate(over="ignore", invalid="ignore"):
            v_size = _largest(v) + span * _largest(stepper.acceleration(stepper.t0, u, v))
            self._natural = _largest(u) + span * v_size, v_size
        self._strange: Stepper | None = None

    @property
    def needs_half(self) -> bool:
        """Whether a chunk should end in the middle of the run."""
        return self._natural[1] == 0

    def see(self, chunk: Chunk) -> None:
        stepper = chunk.stepper
        if self._natural[1] == 0 and stepper.index >= self._half > chunk.first:
            self._natural = _largest(stepper.u), _largest(stepper.v)
        if self._strange is None and self.size(stepper) > _STRANGE:
            self._strange = stepper.before()

    def size(self, stepper: Stepper) -> float:
        """The size of the motion where a stepper stands."""
        sizes = [_largest(x) / natural for x, natural in zip((stepper.u, stepper.v), self._natural, strict=True) if natural]
        return max(sizes, default=0.0)

    def suspect(self, stepper: Stepper) -> Stepper | None:
        """Where a stepper stood before the motion grew strangely; None where it has not grown beyond all measure."""
        largest = max(_largest(stepper.u), _largest(stepper.v))
        if self._strange is None or not (self.size(stepper) > _BLOWN_UP or largest > _OVERFLOWING):
            return None
        return self._strange


def _largest(x: Any) -> float:
    return float(np.abs(x).max())
