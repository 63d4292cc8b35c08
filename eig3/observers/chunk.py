"""The interface between a run and its observers: a run passes one chunk of steps at a time to them."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..stepper import Stepper


class Chunk(NamedTuple):
    """The steps of a run since the last chunk.

    Attributes
    ----------
    first : int
        The step index at which the chunk begins.
    every : int
        `u` and `v` contain the states whose step index is a multiple of this.
    u, v : ndarray, shape (k,) or (k, n)
        These states. The state at `first` belongs to the chunk before.
    stepper : Stepper
        The stepper at the end of the chunk.
    """

    first: int
    every: int
    u: np.ndarray
    v: np.ndarray
    stepper: Stepper


class Observer(Protocol):
    """An object that processes the chunks of a run."""

    def see(self, chunk: Chunk) -> None:
        """Process the next chunk."""
