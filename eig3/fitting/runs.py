"""Runs of a problem with varied parameters, as the members of an ensemble."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..ensembles.solution import EnsembleSolution
from ..problem import Problem
from ..result.solution import Solution
from ..run.chunks import IntegrationError
from .places import Place, said, varied


class Runs:
    """Runs with different values at some places of a problem, and with the same sequence of steps.

    Parameters
    ----------
    problem : Problem
    places : sequence of Place
    **options
        As for `Problem.ensemble`.
    """

    def __init__(self, problem: Problem, places: Sequence[Place], **options: Any) -> None:
        self.problem, self.places, self._options = problem, places, options

    def __call__(self, rows: np.ndarray) -> EnsembleSolution:
        """Run members with these values, shape (m, p)."""
        return self.problem.ensemble(**varied(self.problem, self.places, rows), invariants={}, **self._options)

    @property
    def first(self) -> np.ndarray:
        """The values of the problem, shape (p,)."""
        return np.array([place.value(self.problem) for place in self.places])

    def motion(self) -> Solution:
        """Return the run with the values of the problem, after a check."""
        rows = self.first[None]
        members = self(rows)
        self.check(members, rows)
        return members[0]

    def check(self, members: EnsembleSolution, rows: np.ndarray) -> None:
        """Raise an error that names the values of the first member that did not complete, or has no finite output.

        Raises
        ------
        IntegrationError, ValueError
        """
        failed = np.flatnonzero(~members.success)
        if failed.size:
            i = int(failed[0])
            member = members[i]
            message = f"The run with {said(self.places, rows[i])} fails: {member.explain()}"
            raise IntegrationError(dataclasses.replace(member, message=message))
        for name, values in members.outputs.items():
            bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
            if bad.size:
                raise ValueError(
                    f"outputs[{name!r}] must be finite, but is not with {said(self.places, rows[bad[0]])}."
                )
