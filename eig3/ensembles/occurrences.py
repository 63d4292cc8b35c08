"""The occurrences of events in the members of an ensemble."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..result import frames
from ..result.columns import each
from ..result.labels import Labels
from ..result.occurrences import Occurrences

_STATES = "u", "v", "u_after", "v_after", "z", "z_after"


@dataclass(frozen=True, eq=False)
class MemberOccurrences:
    """The k occurrences of an event in m members, ordered by member and then by time.

    Attributes
    ----------
    member : ndarray of int, shape (k,)
        The member of each occurrence.
    t : ndarray, shape (k,)
        The times of the occurrences.
    u, v : ndarray, shape (k,) or (k, n)
        The states before the `apply` of the event.
    u_after, v_after : ndarray, shape (k,) or (k, n)
        The states after `apply`.
    first : ndarray, shape (m,)
        The time of the first occurrence in each member; NaN if there is none.
    z, z_after : dict of str to ndarray
        First-order unknowns before and after `apply`, by the names of z0.
    labels : Labels or None
        The names and units of the degrees of freedom, as in the ensemble.
    """

    member: np.ndarray
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    u_after: np.ndarray
    v_after: np.ndarray
    first: np.ndarray
    z: dict[str, np.ndarray] = field(default_factory=dict)
    z_after: dict[str, np.ndarray] = field(default_factory=dict)
    labels: Labels | None = None

    @classmethod
    def joined(cls, m: int, none: Occurrences, some: Sequence[tuple[np.ndarray, Occurrences]]) -> MemberOccurrences:
        """Return the occurrences in m members.

        `some` has occurrences with their members, grouped by member and ordered by time; `none` has no occurrence.
        """
        numbers = np.concatenate([np.empty(0, dtype=np.int64), *(member for member, _ in some)])
        order, parts = np.argsort(numbers, kind="stable"), [none, *(found for _, found in some)]
        member, t = numbers[order], np.concatenate([found.t for found in parts])[order]
        states: dict[str, Any] = {}
        for name in _STATES:
            states[name] = each(lambda *x: np.concatenate(x)[order], *(getattr(found, name) for found in parts))
        first = np.full(m, np.nan)
        first[member[::-1]] = t[::-1]  # the first occurrence is written last
        return cls(member, t, first=first, **states, labels=none.labels)

    def __len__(self) -> int:
        return len(self.t)

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each occurrence: its member, its time, and the states."""
        return frames.occurrences_to_pandas(self, member=self.member, t=self.t)

    def of_member(self, i: int) -> Occurrences:
        """Return the occurrences in member i."""
        chosen = slice(*np.searchsorted(self.member, [i, i + 1]))
        states = (each(lambda x: x[chosen], getattr(self, name)) for name in ("t", *_STATES))
        return Occurrences(*states, labels=self.labels)

    def with_part(self, part: MemberOccurrences, first: int) -> MemberOccurrences:
        """Return these occurrences together with the occurrences of a part that begins with member `first`."""
        end = first + len(part.first)
        low, high = np.searchsorted(self.member, [first, end])

        def joined(x: np.ndarray, new: np.ndarray) -> np.ndarray:
            return np.concatenate([x[:low], new, x[high:]])

        return MemberOccurrences(
            joined(self.member, first + part.member),
            joined(self.t, part.t),
            first=np.concatenate([self.first[:first], part.first, self.first[end:]]),
            **{name: each(joined, getattr(self, name), getattr(part, name)) for name in _STATES},
            labels=self.labels,
        )
