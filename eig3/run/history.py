"""The saved states of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..result.mapped import MappedRows, output_files
from ..result.memory import n_rows
from ..stepping.stepper import Cancel, Stepper
from .chunk import Chunk
from .outputs import Output

# Values in an array of a chunk with every state: 512 kB, so that it stays in the second-level cache. With fewer,
# the steps of a large system would take no longer than the calls around them.
_SCRATCH_VALUES = 2**16
_COUNTED = np.arange(2.0**13)


class Saved(NamedTuple):
    """The saved states of a run that has ended, with the values of its outputs and the `width` of its `History`."""

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    outputs: dict[str, np.ndarray]
    width: int


class History:
    """The first state, every `every`-th state and the last state of a run of `n_steps` steps.

    Parameters
    ----------
    n_steps, every : int
    stepper : Stepper
    t_end : float
        The time after the last step, from which t0 + n h may differ by round-off.
    width : int
        The number of values of a state in the largest array of the observers that need every state; 0 if none does. If
        it is not 0, the chunks contain every state.
    shapes : dict of str to tuple of int
        The shapes of the values of outputs in a state, by name.
    directory : Path, optional
        Save the states, and the values of the outputs, in files of this directory.

    Attributes
    ----------
    t, u, v : ndarray, shape (rows, ...)
    outputs : dict of str to ndarray, shape (rows, ...)
        The values of the outputs, which these write.
    """

    def __init__(
        self,
        n_steps: int,
        every: int,
        stepper: Stepper,
        t_end: float,
        width: int,
        shapes: Mapping[str, tuple[int, ...]],
        directory: Path | None = None,
    ) -> None:
        u, v = stepper.start
        rows = n_rows(n_steps, every)
        self.every, self.width = every, width
        self._n_steps, self._t_end = n_steps, t_end
        self._t0, self._h = stepper.t0, stepper.h
        self._closed: Saved | None = None
        self._output_files = output_files(shapes)
        rows_of = {"t": (), "u": np.shape(u), "v": np.shape(v)}
        rows_of |= {file: shapes[name] for name, file in self._output_files.items()}
        self._files = None if directory is None else MappedRows(directory, rows_of, rows)
        self._refer(self._files.arrays if self._files else {x: np.empty((rows, *rows_of[x])) for x in rows_of})
        self.t[0], self.u[0], self.v[0] = stepper.t0, u, v
        self._chunk_every = 1 if width else every
        #: Largest number of steps in a chunk.
        self.most = min(n_steps, max(1, _SCRATCH_VALUES // width)) if width else n_steps
        if self._chunk_every < every:
            shape = self.most, *np.shape(u)
            self._t, self._u, self._v = np.empty(self.most), np.empty(shape), np.empty(shape)

    def _refer(self, arrays: Mapping[str, np.ndarray]) -> None:
        self.t, self.u, self.v = arrays["t"], arrays["u"], arrays["v"]
        self.outputs = {name: arrays[file] for name, file in self._output_files.items()}

    def take(self, earlier: Saved, stepper: Stepper) -> None:
        """Copy the states of an earlier part of the run, which ended at the state of `stepper`."""
        rows = stepper.index // self.every + 1
        for new, old in ((self.t, earlier.t), (self.u, earlier.u), (self.v, earlier.v)):
            new[:rows] = old[:rows]
        self._write_times(self.t[rows - 1 : rows], rows - 1, self.every)  # it may have been the earlier `t_end`

    def advance(self, stepper: Stepper, count: int, cancel: Cancel) -> Chunk:
        """Take `count` steps, or fewer if a solve fails or `cancel` is set, and return them as a chunk."""
        first, every = stepper.index, self._chunk_every
        saved = slice(None)
        begin = first // every + 1
        if every == self.every:
            rows = slice(begin, (first + count) // every + 1)
            t, u, v = self.t[rows], self.u[rows], self.v[rows]
        else:
            t, u, v = self._t[:count], self._u[:count], self._v[:count]
            saved = slice(self.every - 1 - first % self.every, None, self.every)
        stepper.advance(count, every, u, v, cancel)
        chunk = Chunk(first, every, t, u, v, saved, stepper)
        complete = chunk.until(stepper)
        self._write_times(complete.t, begin, every)
        if not (stepper.is_over and every == 1):
            return complete
        taken = stepper.index - first  # the state at the event that ended the run follows the steps
        t[taken], u[taken], v[taken] = stepper.t, stepper.u, stepper.v
        return chunk._replace(t=t[: taken + 1], u=u[: taken + 1], v=v[: taken + 1])

    def _write_times(self, t: np.ndarray, begin: int, every: int) -> None:
        """Write the times after `every` times begin, begin + 1, ... steps."""
        for first in range(0, len(t), len(_COUNTED)):
            part = t[first : first + len(_COUNTED)]
            np.add(_COUNTED[: len(part)], begin + first, out=part)
            part *= every
            part *= self._h
            part += self._t0
        if len(t) and (begin + len(t) - 1) * every == self._n_steps:
            t[-1] = self._t_end

    def see(self, chunk: Chunk) -> None:
        """Save states of a chunk that contains every state."""
        if chunk.every < self.every:  # otherwise the rows of the chunk are rows of the history
            begin = chunk.first // self.every + 1
            for all_rows, rows in ((self.t, chunk.t), (self.u, chunk.u), (self.v, chunk.v)):
                saved = rows[chunk.saved]
                all_rows[begin : begin + len(saved)] = saved

    def remove(self) -> None:
        """Remove the files of the history, if it has any."""
        if self._files:
            self._files.remove()

    def close(self, stepper: Stepper, outputs: Iterable[Output]) -> Saved:
        """Return the saved states and the values of the outputs. The last state is that of `stepper`."""
        if self._closed is None:
            rows = n_rows(stepper.index + stepper.is_within_step, self.every)
            self.t[rows - 1] = self._t_end if stepper.index == self._n_steps else stepper.t
            self.u[rows - 1], self.v[rows - 1] = stepper.u, stepper.v
            for output in outputs:
                output.close(stepper.index, rows)
            if self._files:
                self._files.count = rows
                self._files.close()
                self._refer(self._files.arrays)
            of_outputs = {name: values[:rows] for name, values in self.outputs.items()}
            self._closed = Saved(self.t[:rows], self.u[:rows], self.v[:rows], of_outputs, self.width)
        return self._closed
