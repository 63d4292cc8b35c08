"""Measures of each member: the extremes, the end or the drift of a quantity."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..ensembles.solution import EnsembleSolution
from ..functions.callbacks import check_callback, jit
from ..kernels.compile.source import define
from ..kernels.protocol import SCALAR, VECTOR
from ..problem import Problem
from ..result.solution import Status

KINDS = {
    "max": "largest",
    "min": "smallest",
    "peak": "peak",
    "end": "last",
    "drift": "drift of",
}
_COMPONENTS = re.compile(r"([uv])(\d*)(?:-\1(\d+))?")


@dataclass(frozen=True)
class Measure:
    """A number computed from each member.

    Attributes
    ----------
    kind : str
        "max", "min" and "peak" are the largest value, the smallest value and the largest size over the ends of all
        steps. "end" is the last value, and "drift" the largest change since the first.
    quantity : str
        "energy", a component such as "u0" or "v1", or a difference of two such as "u1-u0".
    """

    kind: str
    quantity: str

    @classmethod
    def parse(cls, text: str) -> Measure:
        """Return the measure of ``KIND:QUANTITY``.

        Raises
        ------
        ValueError
            If the measure does not exist.
        """
        kind, _, quantity = text.replace(" ", "").partition(":")
        if kind not in KINDS or not (quantity == "energy" or _COMPONENTS.fullmatch(quantity)):
            raise ValueError(
                f"--measure must be one of {', '.join(KINDS)}, then a colon, then u0, v0, u1-u0 (any degrees of "
                f"freedom) or energy, such as max:u0, not {text!r}."
            )
        return cls(kind, quantity)

    def __str__(self) -> str:
        return f"{self.kind}:{self.quantity}"

    @property
    def needs_energy(self) -> bool:
        return self.quantity == "energy"

    def label(self, problem: Problem) -> str:
        """Return a label with the unit."""
        return f"{KINDS[self.kind]} {self.quantity} ({self.unit(problem)})"

    def unit(self, problem: Problem) -> str:
        """Return the unit of the measure."""
        if self.needs_energy:
            return problem.energy_unit
        letter, i, _ = self._components()
        return problem.unit(letter, i)

    def _components(self) -> tuple[str, int, int | None]:
        """Return "u" or "v", and the degrees of freedom; the second is None if there is no difference."""
        match = _COMPONENTS.fullmatch(self.quantity)
        assert match
        return match[1], int(match[2] or 0), int(match[3]) if match[3] else None

    def function(self, problem: Problem) -> Any:
        """Return the jitted function of the quantity, for the invariants of an ensemble.

        Raises
        ------
        ValueError
            If the problem has no such quantity.
        """
        if self.needs_energy:
            return self._energy(problem)
        letter, i, j = self._components()
        n = np.size(problem.u0)
        for index in (i, j):
            if index is not None and index >= n:
                has = "one degree of freedom" if n == 1 else f"{n} degrees of freedom, numbered from 0"
                raise ValueError(f"--measure {self} does not fit: {problem.name} has {has}.")
        if np.ndim(problem.u0) == 0:
            return _quantity(letter if j is None else "0.0")
        if n > 1 and self.quantity == letter:
            raise ValueError(f"--measure {self} must say which degree of freedom, such as {self.kind}:{letter}0.")
        return _quantity(f"{letter}[{i}]" + (f" - {letter}[{j}]" if j is not None else ""))

    def _energy(self, problem: Problem) -> Any:
        """Return the energy. If the problem integrates the work, the drift is for the energy minus the work."""
        if problem.energy is None:
            raise ValueError(f"--measure {self} does not fit: {problem.name} has no energy with these parameters.")
        if problem.z0 and not problem.unknowns.is_read and self.kind != "drift":
            n = np.size(problem.u0)
            return _quantity(f"energy(t, u[:{n}], v[:{n}], p)", problem.energy)
        return problem.energy

    def of(self, solution: EnsembleSolution, name: str, function: Any) -> np.ndarray:
        """Return the measure of each member, shape (m,); NaN for members that did not reach the end.

        `function` is the invariant `name` of the ensemble, unless the measure is the value at the end.
        """
        if self.kind == "end":
            values = _at_end(solution, function)
        elif self.kind == "drift":
            values = solution.drift[name]
        else:
            low, high, *_ = solution.extremes[name]
            values = {"min": low, "max": high, "peak": np.maximum(np.abs(low), np.abs(high))}[self.kind]
        return np.where(solution.status == Status.COMPLETED, values, np.nan)


@functools.cache
def _quantity(expression: str, energy: Any = None) -> Any:
    text = f"@jit\ndef quantity(t, u, v, p):\n    return {expression}\n"
    return define(text, "measure", {"jit": jit, "energy": energy})["quantity"]


def _at_end(solution: EnsembleSolution, function: Any) -> np.ndarray:
    """Return the values of a function in the last states."""
    form = SCALAR if solution.u.ndim == 2 else VECTOR
    call = check_callback(function, "invariant", form, "measure").call
    t, u, v = solution.t[:, -1].tolist(), solution.u[:, -1], solution.v[:, -1]
    states = zip(t, *(x.tolist() if form is SCALAR else x for x in (u, v)), strict=True)
    params = np.broadcast_to(solution.params, (len(solution), solution.params.shape[-1]))
    return np.array([call(*state, p) for state, p in zip(states, params, strict=True)])
