"""The parts of an ensemble, and what comes of them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from ..methods import Method
from ..result.memory import n_rows
from ..result.solution import Solution
from .histories import Histories
from .members import Members
from .solution import EnsembleSolution, Reduce

_UNIT = 128  # members; the number in a part is a multiple of it, so that a part fills the lanes of its blocks
_PARTS = 128  # as long as the parts stay below the following limits
_MOST_MEMBERS = 100_000
_MOST_SAVED = 2**26  # bytes of the saved states of a part
_MOST_GIVEN = 2**22  # bytes of the start and the parameters of a part, which travel to a worker
_NOT_BACK = "The run was interrupted before this member was back."


@dataclass(frozen=True)
class Part:
    """Some members of an ensemble.

    Attributes
    ----------
    number : int
        The number of the part.
    first : int
        The number of its first member.
    members : Members
    """

    number: int
    first: int
    members: Members

    def __len__(self) -> int:
        return len(self.members)


def parts_of(members: Members, save_every: int | None, n_outputs: int = 0) -> list[Part]:
    """Divide an ensemble. The parts depend on the ensemble only, so that `reduce` gets the same ones everywhere.

    `n_outputs` is the number of values of all outputs in a state.
    """
    rows = 2 if save_every is None else n_rows(int(members.n_steps.max()), save_every)
    given = 2 * members.n + members.params.shape[-1] * members.has_own_params
    most = min(_MOST_MEMBERS, _MOST_SAVED // (8 * (2 * members.n + n_outputs) * rows), _MOST_GIVEN // (8 * given))
    count = _UNIT * max(1, min(-(-len(members) // (_PARTS * _UNIT)), most // _UNIT))
    firsts = range(0, len(members), count)
    return [Part(number, first, members.part(slice(first, first + count))) for number, first in enumerate(firsts)]


@dataclass(frozen=True)
class Recipe:
    """What to do with a part.

    Attributes
    ----------
    march : callable
        ``march(members, first, threads)`` integrates the members.
    reduce : callable or None
        ``reduce(solution)`` returns what the user needs of a part; None if that is everything.
    """

    march: Callable[[Members, int, int], EnsembleSolution]
    reduce: Reduce | None

    def __call__(self, part: Part, threads: int) -> Any:
        solution = self.march(part.members, part.first, threads)
        return solution if self.reduce is None else self.reduce(solution)


class Results(Protocol):
    """What comes of the parts, which may end in any order."""

    def put(self, part: Part, value: Any) -> None:
        """Store what came of a part."""

    def rescue(self, error: BaseException) -> None:
        """Store what an exception left of a part."""

    def whole(self, note: str) -> Any:
        """Return the results of all parts, with a sentence for the user about how they ran."""


class Listed:
    """What `reduce` returned for each part; None for a part that is not finished."""

    def __init__(self, count: int) -> None:
        self.values: list[Any] = [None] * count

    def put(self, part: Part, value: Any) -> None:
        self.values[part.number] = value

    def rescue(self, error: BaseException) -> None:
        """Do nothing: `reduce` gets finished parts only."""

    def whole(self, note: str) -> list[Any]:
        if note:
            warnings.warn(note, RuntimeWarning, stacklevel=5)
        return self.values


class Joined:
    """The results of all members, as if they had run together.

    Parameters
    ----------
    histories : Histories
        Those of the whole ensemble.
    rhs : jitted function
    method : Method
    repeat : callable
        ``repeat(i)`` runs member i again, alone.
    """

    def __init__(self, histories: Histories, rhs: Any, method: Method, repeat: Callable[[int], Solution]) -> None:
        self.histories, self.rhs, self.method, self.repeat = histories, rhs, method, repeat
        self.seconds, self.notes = 0.0, dict[str, None]()  # a dict keeps the order, and each note once
        histories.message[:] = _NOT_BACK

    def put(self, part: Part, value: EnsembleSolution) -> None:
        self._put(value)

    def rescue(self, error: BaseException) -> None:
        solution = getattr(error, "solution", None)
        if isinstance(solution, EnsembleSolution):
            self._put(solution)

    def _put(self, solution: EnsembleSolution) -> None:
        self.histories.place(solution)
        self.seconds += solution.kernel_seconds
        self.notes |= dict.fromkeys(solution.notes)

    def whole(self, note: str) -> EnsembleSolution:
        notes = *self.notes, *([note] if note else [])
        return self.histories.solution(self.rhs, self.method, 0, self.seconds, notes, self.repeat)
