"""The occurrences of events in a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from . import frames
from .labels import Labels


@dataclass(frozen=True, eq=False)
class Occurrences:
    """The occurrences of an event in a run.

    Attributes
    ----------
    t : ndarray, shape (k,)
        The times of the occurrences.
    u, v : ndarray, shape (k,) or (k, n)
        The states before the `apply` of the event.
    u_after, v_after : ndarray, shape (k,) or (k, n)
        The states after `apply`; the same as u and v if the event has no `apply`.
    z, z_after : dict of str to ndarray
        First-order unknowns before and after `apply`, by the names of z0.
    labels : Labels or None
        The names and units of the degrees of freedom, as in the solution.
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    u_after: np.ndarray
    v_after: np.ndarray
    z: dict[str, np.ndarray] = field(default_factory=dict)
    z_after: dict[str, np.ndarray] = field(default_factory=dict)
    labels: Labels | None = field(default=None, kw_only=True)  # a file has the labels of the solution only

    def __len__(self) -> int:
        return len(self.t)

    def separated(self, unknowns: Any) -> Occurrences:
        """Return the occurrences with the `FirstOrder` unknowns, which are the last degrees of freedom, as z."""
        u, v, z = unknowns.separated(self.u, self.v)
        u_after, v_after, z_after = unknowns.separated(self.u_after, self.v_after)
        return replace(self, u=u, v=v, u_after=u_after, v_after=v_after, z=z, z_after=z_after)

    @property
    def jumps(self) -> Occurrences:
        """The occurrences at which `apply` changed the state."""
        some = is_jump(self)
        return self.map(lambda x: x[some])

    def map(self, function: Callable[[np.ndarray], np.ndarray]) -> Occurrences:
        """Return the occurrences with ``function(x)`` for each array x."""
        t, u, v, u_after, v_after = map(function, (self.t, self.u, self.v, self.u_after, self.v_after))
        z, z_after = ({name: function(x) for name, x in each.items()} for each in (self.z, self.z_after))
        return Occurrences(t, u, v, u_after, v_after, z, z_after, labels=self.labels)

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each occurrence: its time, and the states before and after.

        The columns of a state have the names and units of the solution's table, with "_after" after `apply`.
        """
        return frames.occurrences_to_pandas(self, t=self.t)


def labelled(events: Mapping[str, Any], labels: Labels | None) -> dict[str, Any]:
    """Return the occurrences of events with the labels of their solution."""
    return {name: replace(found, labels=labels) for name, found in events.items()}


def is_jump(found: Any) -> np.ndarray:
    """Return at which occurrences, of a run or of members, `apply` changed the state."""
    of_z = zip(found.z.values(), found.z_after.values(), strict=True)
    pairs = (found.u, found.u_after), (found.v, found.v_after), *of_z
    changed = [(before != after).any(axis=tuple(range(1, before.ndim))) for before, after in pairs]
    return np.any(changed, axis=0)
