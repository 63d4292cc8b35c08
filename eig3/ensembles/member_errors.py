"""The estimated errors of the members of an ensemble, from the same ensemble with other steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..result.error_estimate import Companion, ErrorEstimate, PlainErrors, estimate, losses
from ..result.solution import Solution, Status


class MemberErrors:
    """The estimated errors of the m members of an ensemble; ``errors[i]`` has the errors of member i.

    They are computed when they are read.

    Parameters
    ----------
    solution : EnsembleSolution
    others : sequence of (EnsembleSolution, float)
        The finer and, if it can be compared, the coarser ensemble, with the ratios of their steps or tolerances.
    starts : dict of str to ndarray, shape (m,)
        The values at the start of the invariants that are no energy minus the work.

    Attributes
    ----------
    largest : dict of str to ndarray, shape (m,)
        The largest absolute error of u, v, and each output, first-order unknown, invariant and event time, by name.
    order : ndarray, shape (m,)
        The order that each member shows; NaN if it is not known.
    reliable_until : ndarray, shape (m,)
        The last saved time at which a digit of u is right, or -inf; NaN if it is the end.
    """

    def __init__(self, solution: Any, others: Sequence[tuple[Any, float]], starts: Mapping[str, np.ndarray]) -> None:
        self._solution, self._others, self._starts = solution, others, dict(starts)

    @classmethod
    def loaded(cls, solution: Any, kept: Any, read: Callable[[Any], Any]) -> MemberErrors:
        """Return the errors from the fields of a file, in which ``read(fields)`` returns an ensemble."""
        others = [(read(fields), float(ratio)) for fields, ratio in kept["others"]]
        names = [(len(x), np.shape(x.u)[2:], *map(sorted, _named(x))) for x in (solution, *(x for x, _ in others))]
        if not others or any(other != names[0] for other in names):
            raise ValueError("the compared ensembles are of another kind.")
        starts = {name: np.asarray(x, dtype=float) for name, x in kept["starts"].items()}
        if any(name not in solution.drift or x.shape != (len(solution),) for name, x in starts.items()):
            raise ValueError("the invariants are others.")
        return cls(solution, others, starts)

    def kept(self) -> dict[str, Any]:
        """Return the fields for a file."""
        return {"others": [(x.__getstate__(), ratio) for x, ratio in self._others], "starts": self._starts}

    def __len__(self) -> int:
        return len(self._solution)

    def __iter__(self) -> Iterator[ErrorEstimate | None]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> ErrorEstimate | None:
        """Return the errors of a member; None if it failed, or if a compared run was interrupted."""
        member = self._solution[i]
        if not member.success or any(other.status[i] is Status.INTERRUPTED for other, _ in self._others):
            return None
        fine, *coarse = (_companion(member, other[i], ratio) for other, ratio in self._others)
        error = estimate(member, fine, coarse[0] if coarse else None)
        starts = {name: float(x[i]) for name, x in self._starts.items()}
        return replace(error, notes=(*error.notes, *losses(member, error, starts)))

    @property
    def is_interrupted(self) -> bool:
        """Whether the ensemble, or a compared ensemble, was interrupted, so that some members have no errors."""
        ensembles = self._solution, *(other for other, _ in self._others)
        return any((each.status == Status.INTERRUPTED).any() for each in ensembles)

    @cached_property
    def _plain(self) -> PlainErrors:
        """The errors of the members that need no note, which are computed together."""
        return PlainErrors.of(self._solution, *self._others)

    @cached_property
    def _others_than_plain(self) -> dict[int, ErrorEstimate | None]:
        return {i: self[i] for i in np.flatnonzero(~self._plain.chosen).tolist()}

    @property
    def largest(self) -> dict[str, np.ndarray]:
        found = {name: x.copy() for name, x in self._plain.largest.items()}
        for i, error in self._others_than_plain.items():
            for name, x in (error.largest if error else {}).items():
                found.setdefault(name, np.full(len(self), np.nan))[i] = x
        return found

    @property
    def order(self) -> np.ndarray:
        return self._numbers("order", self._plain.order)

    @property
    def reliable_until(self) -> np.ndarray:
        return self._numbers("reliable_until", np.full(len(self), np.nan))

    def _numbers(self, name: str, plain: np.ndarray) -> np.ndarray:
        values = plain.copy()
        for i, error in self._others_than_plain.items():
            x = None if error is None else getattr(error, name)
            values[i] = np.nan if x is None else x
        return values

    def __repr__(self) -> str:
        errors = self.largest.get("u", np.empty(0))
        return f"error of u at most {np.nanmax(errors, initial=0.0):.2g} in {np.isfinite(errors).sum()} members"


def _named(solution: Any) -> tuple[Any, ...]:
    return solution.outputs, solution.z, solution.drift, solution.extremes, solution.events


def _companion(member: Solution, other: Solution, ratio: float) -> Companion:
    if member.steps is None:
        return Companion.at_same_steps(member, other, other.h / member.h)
    return Companion.between_steps(member, other, ratio)
