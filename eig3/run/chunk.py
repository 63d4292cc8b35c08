"""The interface between a run and its observers: a run passes one chunk of steps at a time to them."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..stepping.stepper import Stepper


class Chunk(NamedTuple):
    """The steps of a run since the last chunk.

    Attributes
    ----------
    first : int
        The step index at which the chunk begins.
    every : int
        The rows contain the states whose step index is a multiple of this.
    t : ndarray, shape (k,)
        The times of these states. The state at `first` belongs to the chunk before.
    u, v : ndarray, shape (k,) or (k, n)
        The states.
    saved : slice
        The rows that the run saves.
    stepper : Stepper
        The stepper at the end of the chunk.
    """

    first: int
    every: int
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    saved: slice
    stepper: Stepper

    def until(self, stepper: Stepper) -> Chunk:
        """Return the part of the chunk up to an earlier state."""
        rows = stepper.index // self.every - self.first // self.every
        return self._replace(t=self.t[:rows], u=self.u[:rows], v=self.v[:rows], stepper=stepper)


class Observer(Protocol):
    """An object that processes the chunks of a run."""

    def see(self, chunk: Chunk) -> None:
        """Process the next chunk."""
