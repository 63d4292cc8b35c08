"""Placed effects: effects with their points, and with the parameters of each member as columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .effect import FORCES, RATE, RESETS, Effect, Motion, arguments


@dataclass(frozen=True, eq=False)
class Placed:
    """Effects of one kind on some points.

    Attributes
    ----------
    effect : Effect
        One of the effects, for its functions and names.
    columns : dict of str to ndarray or list
        The parameters by name. For a field in `arrays` of several motions, it is the list of their arrays.
    points : tuple of ndarray of int, shape (members,)
        The points of each argument; none for an effect on all masses.
    """

    effect: Effect
    columns: dict[str, Any]
    points: tuple[np.ndarray, ...] = ()

    @cached_property
    def _functions(self) -> dict[str, Any]:
        return self.effect.functions()

    @property
    def is_conservative(self) -> bool:
        """Whether the work of the effects is the change of their potential."""
        functions = self._functions
        return not functions.keys() & {*RESETS, RATE} and ("potential" in functions or not functions.keys() & FORCES)

    def value(self, name: str, member: int) -> Any:
        """Return a parameter of a member as functions take it: an array, a tuple for a vector, or a number."""
        column = self.columns[name]
        if name in self.effect.arrays:
            values = np.array(column)
            values.flags.writeable = False
            return values
        value = column[member if len(column) > 1 else 0]
        return tuple(value.tolist()) if name in self.effect.vectors else float(value)

    def call(self, name: str, member: int, given: dict[str, Any]) -> Any:
        """Call a function for a member, with the given arguments, and otherwise with its parameters."""
        function = self._functions[name]
        size = self.effect.state_size
        values = {"state": 0.0 if size == 1 else (0.0,) * size, **given}
        return function(*(values[a] if a in values else self.value(a, member) for a in arguments(function)))

    def take(self, members: np.ndarray) -> Placed:
        """Return the effects of some members, or of all members in another order."""
        arrays = self.effect.arrays
        columns = {name: column if name in arrays else column[members] for name, column in self.columns.items()}
        return Placed(self.effect, columns, tuple(points[members] for points in self.points))


def joined(parts: Sequence[Placed], of_arrays: Callable[[list[Any]], Any] = lambda arrays: arrays[0]) -> Placed:
    """Merge effects of one kind with all their members; `of_arrays` merges values that are not columns of members."""
    one = parts[0]
    if len(parts) == 1:
        return one
    columns = {
        name: (of_arrays if name in one.effect.arrays else np.concatenate)([part.columns[name] for part in parts])
        for name in one.columns
    }
    return Placed(one.effect, columns, tuple(map(np.concatenate, zip(*(part.points for part in parts), strict=True))))


def moves(placed: Sequence[Placed]) -> list[tuple[Any, tuple, np.ndarray, np.ndarray]]:
    """Return the motions of supports: functions, their arguments after the time, directions and points."""
    found = []
    for law in placed:
        if isinstance(law.effect, Motion):
            function = law.effect.functions()["motion"]
            given = tuple(law.value(name, 0) for name in arguments(function) if name != "t")
            found.append((function, given, law.columns["direction"][0], law.points[0]))
    return found
