"""The parts of an ensemble, and their results."""

from __future__ import annotations

import itertools
import warnings
from typing import Any

from ..stepping.run_options import RunOptions
from .files import Directory
from .lanewise import FEWEST_MEMBERS
from .members import Members
from .solution import EnsembleSolution

_UNIT = 128  # members; a part has a multiple of this number, which fills the lanes of its blocks
_PARTS = 128  # as long as the parts stay below the following limits
_MOST_MEMBERS = 100_000
_MOST_SAVED = 2**26  # bytes of the saved states of a part
_MOST_GIVEN = 2**22  # bytes of the initial values and the parameters of a part, which are sent to a worker
_NOT_BACK = "The run was interrupted before this member was returned."


def parts_of(members: Members, options: RunOptions) -> list[Members]:
    """Divide an ensemble. The parts depend only on the ensemble, so `reduce` gets the same parts everywhere.

    Members run in lanes in a part if they run in lanes in the whole ensemble: no part has only a few members.
    """
    rows, n_outputs = options.rows(int(members.n_steps.max())), options.functions.n_outputs
    given = 2 * members.n + members.params.shape[-1] * members.has_own_params
    most = min(_MOST_MEMBERS, _MOST_SAVED // (8 * (2 * members.n + n_outputs) * rows), _MOST_GIVEN // (8 * given))
    count = _UNIT * max(1, min(-(-len(members) // (_PARTS * _UNIT)), most // _UNIT))
    firsts = [0, *range(count, len(members) - FEWEST_MEMBERS + 1, count), len(members)]
    return [members.part(slice(*ends)) for ends in itertools.pairwise(firsts)]


class Listed:
    """The return values of `reduce` for each part; None for an unfinished part."""

    def __init__(self, parts: list[Members]) -> None:
        self._values: dict[int, Any] = dict.fromkeys(part.first for part in parts)

    def put(self, part: Members, value: Any) -> None:
        """Store the result of a part."""
        self._values[part.first] = value

    def rescue(self, solution: Any) -> None:
        """Do nothing: `reduce` gets finished parts only."""

    def whole(self, note: str) -> list[Any]:
        """Return the results of all parts, with a sentence for the user about how they ran."""
        if note:
            warnings.warn(note, RuntimeWarning, stacklevel=5)
        return [*self._values.values()]


class Joined:
    """The results of all members, as if they had run together.

    `blank` is the ensemble with its members at their start. Each part is written to the directory `place`, if any.
    """

    def __init__(self, blank: EnsembleSolution, place: Directory | None = None) -> None:
        self.solution, self.place = blank, place
        self._n_taken = 0
        blank.message[:] = _NOT_BACK
        if place:
            place.begin(blank)

    def left(self, parts: list[Members]) -> list[Members]:
        """Take the parts that an earlier run has written to the directory, and return the others."""
        return [part for part in parts if not self._take(part)]

    def _take(self, part: Members) -> bool:
        solution = self.place.finished(part.first, len(part)) if self.place else None
        if solution is None:
            return False
        self._n_taken += len(part)
        self.solution._place(solution)
        return True

    def put(self, part: Members, value: EnsembleSolution) -> None:
        self.rescue(value)

    def rescue(self, solution: Any) -> None:
        """Store the members of a part, also of a part that a cancellation or an exception ended."""
        if isinstance(solution, EnsembleSolution):
            if self.place:
                self.place.put(solution)
            self.solution._place(solution)

    def whole(self, note: str) -> EnsembleSolution:
        taken = f"An earlier run had finished {self._n_taken} of {len(self.solution)} members." if self._n_taken else ""
        self.solution.notes = *self.solution.notes, *filter(None, (taken, note))
        return self.solution


#: The results of the parts, which may end in any order.
Results = Listed | Joined
