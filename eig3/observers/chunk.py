"""What a run shows to those that watch it: one chunk of steps at a time."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..stepper import Stepper


class Chunk(NamedTuple):
    """The steps that a run took since its observers last looked.

    Attributes
    ----------
    first : int
        The step index at which the chunk begins.
    every : int
        `u` and `v` hold each state whose step index is a multiple of this.
    u, v : ndarray, shape (k,) or (k, n)
        These states, without the one at `first`.
    stepper : Stepper
        It stands at the end of the chunk.
    """

    first: int
    every: int
    u: np.ndarray
    v: np.ndarray
    stepper: Stepper


class Observer(Protocol):
    """What watches a run."""

    def see(self, chunk: Chunk) -> None:
        """Take in the next chunk."""
