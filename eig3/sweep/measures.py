"""Measures of each member: the extremes, the end or the drift of a quantity."""

from __future__ import annotations

import functools
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..ensembles.solution import EnsembleSolution
from ..functions.callbacks import jit
from ..functions.layout import bound_layout
from ..kernels.compile.source import define
from ..problem import Problem
from ..result.labels import with_unit
from ..result.solution import Status

KINDS = {"max": "largest", "min": "smallest", "peak": "peak", "end": "last", "drift": "drift of"}
_COMPONENTS = re.compile(r"([uv])(\d*)(?:-\1(\d+))?")
_OUTPUT = re.compile(r"(.+?)(?:\[.+\])?")


@dataclass(frozen=True)
class Measure:
    """A number computed from each member.

    Attributes
    ----------
    kind : str
        "max", "min" and "peak" are the largest value, the smallest value and the largest size over the ends of all
        steps. "end" is the last value, and "drift" the largest change since the first.
    quantity : str
        "energy"; a component such as "u0" or "v1", or a difference of two such as "u1-u0"; or an output of the problem
        such as "moments", of whose values the extreme one counts, or one of its values by its number or its name, such
        as "moments[3]" or "forces[left]".
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
        kind, _, quantity = text.partition(":")
        joined = quantity.replace(" ", "")  # the name of an output may have spaces
        measure = cls(kind.strip(), joined if _COMPONENTS.fullmatch(joined) else quantity.strip())
        if measure.kind not in KINDS or not measure.quantity:
            raise measure._unknown()
        return measure

    def _unknown(self, outputs: Collection[str] = ()) -> ValueError:
        """Return the error for a measure that does not exist; `outputs` are the names of the problem's outputs."""
        return ValueError(
            f"--measure must be one of {', '.join(KINDS)}, then a colon, then u0, v0, u1-u0 (any degrees of freedom), "
            f"{''.join(f'{name}, ' for name in outputs)}or energy, such as max:u0, not {str(self)!r}."
        )

    def __str__(self) -> str:
        return f"{self.kind}:{self.quantity}"

    @property
    def needs_energy(self) -> bool:
        return self.quantity == "energy"

    def label(self, problem: Problem) -> str:
        """Return a label with the unit."""
        return self.with_unit(f"{KINDS[self.kind]} {self.quantity}", problem)

    def with_unit(self, text: str, problem: Problem) -> str:
        """Return a text with the unit of the measure, if it is known."""
        return with_unit(text, self._unit(problem))

    def _unit(self, problem: Problem) -> str:
        if self.needs_energy:
            return problem.energy_unit
        if self.output:
            name, names, place = self._value(problem)
            return problem.labels.unit_of_values(name, range(len(names)) if place is None else [place])
        letter, *both = self._components()
        return " - ".join(dict.fromkeys(problem.unit(letter, i) for i in both if i is not None))

    @property
    def output(self) -> str:
        """The name of the output that is measured; empty for other quantities."""
        match = None if self.needs_energy or _COMPONENTS.fullmatch(self.quantity) else _OUTPUT.fullmatch(self.quantity)
        return match[1] if match else ""

    def _components(self) -> tuple[str, int, int | None]:
        """Return "u" or "v", and the degrees of freedom; the second is None if there is no difference."""
        match = _COMPONENTS.fullmatch(self.quantity)
        assert match
        return match[1], int(match[2] or 0), int(match[3]) if match[3] else None

    def function(self, problem: Problem) -> Any:
        """Return the quantity as an output of an ensemble: a jitted function, or the output of the problem.

        Raises
        ------
        ValueError
            If the problem has no such quantity.
        """
        if self.needs_energy:
            return self._energy(problem)
        if self.output:
            return self._checked_output(problem)
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

    def _checked_output(self, problem: Problem) -> Any:
        name, names, place = self._value(problem)
        count = len(names)
        if self.kind == "drift":
            raise ValueError(f"--measure {self} does not fit: take max, min, peak or end of an output.")
        if place is None and self.kind == "end" and count > 1:
            raise ValueError(f"--measure {self} must say which of the {count} values, such as {self}[{names[0]}].")
        if place is not None and place >= count:
            has = f"{count} values, numbered from 0" if names[0] == "0" else f"the values {', '.join(names)}"
            raise ValueError(f"--measure {self} does not fit: {name} has {has}.")
        return problem.outputs[name]

    def _value(self, problem: Problem) -> tuple[str, list[str], int | None]:
        """Return the output, the names or the numbers of its values, and which value is measured; None for all."""
        if self.quantity in problem.outputs:
            name, value = self.quantity, ""
        else:
            name, value = self.output, self.quantity.removeprefix(self.output)[1:-1]
        if name not in problem.outputs:
            raise self._unknown(problem.outputs)
        output = problem.outputs[name]
        given = output[1] if isinstance(output, tuple) else 1
        names = [*map(str, given if isinstance(given, list | tuple) else range(given))]
        if not value:
            return name, names, None
        return name, names, names.index(value) if value in names else int(value) if value.isdecimal() else len(names)

    def _energy(self, problem: Problem) -> Any:
        """Return the energy. If the problem integrates the work, the drift is for the energy minus the work."""
        if problem.energy is None:
            raise ValueError(f"--measure {self} does not fit: {problem.name} has no energy with these parameters.")
        if problem.z0 and self.kind != "drift":
            own = "" if problem.unknowns.is_read else f"[:{np.size(problem.u0)}]"
            energy = problem.energy
            if bound_layout(energy):  # the new function takes parameters with names, and is bound later
                energy = energy.py_func.inner
            return _quantity(f"energy(t, u{own}, v{own}, p)", energy)
        return problem.energy

    def of(self, solution: EnsembleSolution, name: str, problem: Problem) -> np.ndarray:
        """Return the measure of each member, shape (m,); NaN for members that did not reach the end.

        `name` is the name of the output with the quantity, or for a drift of the invariant.
        """
        if self.kind == "drift":
            values = solution.drift[name]
        elif self.kind == "end":
            values = self._chosen(solution.outputs[name][:, -1], problem)
        else:
            low, high = (self._chosen(x, problem) for x in solution.extremes[name][:2])
            values = {"min": low, "max": high, "peak": np.maximum(np.abs(low), np.abs(high))}[self.kind]
        if values.ndim > 1:
            values = values.min(axis=1) if self.kind == "min" else values.max(axis=1)
        return np.where(solution.status == Status.COMPLETED, values, np.nan)

    def _chosen(self, values: np.ndarray, problem: Problem) -> np.ndarray:
        """Return one value of an output of each member, shape (m,), or the values, shape (m,) or (m, k)."""
        place = self._value(problem)[2] if self.output else None
        return values if place is None else values.reshape(len(values), -1)[:, place]


@functools.cache
def _quantity(expression: str, energy: Any = None) -> Any:
    text = f"@jit\ndef quantity(t, u, v, p):\n    return {expression}\n"
    return define(text, "measure", {"jit": jit, "energy": energy})["quantity"]
