"""Time histories of displacements, velocities, outputs and z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False, repr=False)
class History:
    """Displacements, velocities, outputs and z at some times, or their derivatives, or the errors of these.

    Attributes
    ----------
    u, v : ndarray, shape (s,) or (s, n)
    outputs : dict of str to ndarray, shape (s,) or (s, k)
    z : dict of str to ndarray, shape (s,) or (s, k)
        For derivatives with respect to p parameters, all arrays have a further first axis of length p.
    """

    u: np.ndarray
    v: np.ndarray
    outputs: dict[str, np.ndarray]
    z: dict[str, np.ndarray]

    def map(self, function: Callable[[np.ndarray], np.ndarray]) -> History:
        """Return the history of ``function(x)`` for each array x."""
        groups = ({name: function(x) for name, x in group.items()} for group in (self.outputs, self.z))
        return History(function(self.u), function(self.v), *groups)

    def less(self, other: History) -> History:
        """Return the history of the differences from another one."""
        pairs = (self.outputs, other.outputs), (self.z, other.z)
        groups = ({name: x - theirs[name] for name, x in own.items()} for own, theirs in pairs)
        return History(self.u - other.u, self.v - other.v, *groups)

    def __getitem__(self, i: Any) -> History:
        """Return the history of one parameter, by its number."""
        return self.map(lambda x: x[i])

    def __repr__(self) -> str:
        names = ["u", "v", *self.outputs, *self.z]
        return f"History of {', '.join(names)} in arrays whose shape begins with {self.u.shape}"
