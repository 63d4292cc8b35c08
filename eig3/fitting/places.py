"""The names of parameters and of entries of the initial values, and their places in a problem."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..functions.checks import check_params, shown
from ..functions.first_order import UNNAMED
from ..functions.layout import unknown_name
from ..problem import Problem
from ..result.solution import Solution

_LEAST = 1e-200  # a smaller size counts as zero
_NAME = re.compile(r"(\w+)(?:\[(\d+)(?:, ?(\d+))?\])?")
_FLAT = "p"  # the name of parameters without names, as functions call them


class Place(NamedTuple):
    """The place of a value in a problem.

    Attributes
    ----------
    name : str
        As the user wrote it, such as "k", "k[2]", "p[3]" or "u0[1]".
    field : str
        "u0", "v0", "z0" or "params".
    key : str
        The name of the parameter or of the first-order unknown; empty for u0, v0 and an array of parameters.
    entry : tuple of int
        The index in the array; empty for a number.
    """

    name: str
    field: str
    key: str
    entry: tuple[int, ...]

    def array(self, problem: Problem) -> np.ndarray:
        """Return the array that contains the value, of shape () for a number."""
        if self.key:
            named = problem.z0 if self.field == "z0" else problem.params
            return np.asarray(named[self.key], dtype=np.float64)
        if self.field == "params":
            return check_params(problem.params)
        return np.asarray(getattr(problem, self.field), dtype=np.float64)

    def value(self, problem: Problem) -> float:
        """Return the value."""
        return float(self.array(problem)[self.entry])

    def offset(self, problem: Problem) -> int:
        """Return the index in the flat array u0, v0 or p of the kernels; z0 is at the end of v0."""
        begin = 0
        if self.field == "z0":
            begin = np.size(problem.u0) + problem.unknowns.begin(self.key)
        elif self.key:
            begin = problem.params.layout.places(problem.params._asdict())[self.key].start
        return begin + (int(np.ravel_multi_index(self.entry, self.array(problem).shape)) if self.entry else 0)

    def size(self, problem: Problem) -> float:
        """Return the size of the value, or the size of the largest value in its named array if it is zero."""
        return abs(self.value(problem)) or (float(np.abs(self.array(problem)).max()) if self.key else 0.0)


def check_places(problem: Problem, names: str | Iterable[str]) -> list[Place]:
    """Return the places of the values with these names.

    Raises
    ------
    TypeError, ValueError
        If a value does not exist or is not a real number, if a name is given twice, or if problem is not a Problem.
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem must be an eig3.Problem, not {shown(problem)}.")
    if not isinstance(names, Iterable):
        raise TypeError(f"parameters must be a name such as 'k' or a sequence of names, not {shown(names)}.")
    given = [names] if isinstance(names, str) else list(names)
    if not given:
        raise ValueError("parameters must name at least one parameter, such as 'k' or 'u0[1]', but it is empty.")
    places = [_place(problem, name) for name in given]
    for i, place in enumerate(places):
        if any(place[1:] == other[1:] for other in places[:i]):
            raise ValueError(f"parameters must name each value once, but {place.name} is there twice.")
    return places


def sizes(
    problem: Problem, places: Sequence[Place], motion: Callable[[], Solution], of_zeros: np.ndarray | float = 1.0
) -> np.ndarray:
    """Return the sizes of the values, shape (p,).

    The size of a value is its magnitude. For a value of zero, it is the magnitude of the largest value in its named
    array, or for an initial value the size of the motion, or otherwise `of_zeros`.
    """
    found = np.array([place.size(problem) for place in places])
    resting = [i for i, place in enumerate(places) if found[i] < _LEAST and place.field != "params"]
    if resting:
        run = motion()
        states = {"u0": run.u, "v0": run.v}
        for i in resting:
            each: tuple[Any, ...] = (slice(None), *places[i].entry)
            found[i] = np.abs((run.z[places[i].key] if places[i].key else states[places[i].field])[each]).max()
    return np.where(found < _LEAST, of_zeros, found)


def said(places: Sequence[Place], values: np.ndarray) -> str:
    """Return the values with their names, for an error."""
    return ", ".join(f"{place.name} = {value:.10g}" for place, value in zip(places, values, strict=True))


def varied(problem: Problem, places: Sequence[Place], rows: np.ndarray) -> dict[str, Any]:
    """Return the arguments of `Problem.ensemble` for members with these values at the places, shape (m, p)."""
    arrays: dict[tuple[str, str], np.ndarray] = {}
    for place, column in zip(places, rows.T, strict=True):
        array = arrays.setdefault(place[1:3], np.repeat(place.array(problem)[None], len(rows), axis=0))
        each: tuple[Any, ...] = (slice(None), *place.entry)
        array[each] = column
    found: dict[str, Any] = {field: array for (field, key), array in arrays.items() if not key}
    for (field, key), array in arrays.items():
        if key:
            found.setdefault(field, {})[key] = array
    return found


def changed(problem: Problem, places: Sequence[Place], values: np.ndarray) -> Problem:
    """Return the problem with other values, shape (p,), at the places."""
    changes: dict[str, Any] = {}
    for field, arrays in varied(problem, places, values[None]).items():
        changes[field] = {name: x[0] for name, x in arrays.items()} if isinstance(arrays, dict) else arrays[0]
    return problem.with_(**changes)


def _place(problem: Problem, name: Any) -> Place:
    match = _NAME.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise ValueError(f"parameters must hold names such as 'k', 'k[2]', 'p[3]' or 'u0[1]', not {shown(name)}.")
    head, index = match[1], tuple(int(i) for i in match.groups()[1:] if i is not None)
    heads = _heads(problem)
    if head not in heads:
        if _FLAT in heads:
            last = check_params(problem.params).size - 1
            raise ValueError(
                f"{problem.name} has no {head}: its parameters have numbers, p[0] to p[{last}], in the order of "
                f"problem.params. Other names are {', '.join(other for other in heads if other != _FLAT)}."
            )
        raise unknown_name(f"{problem.name} has", head, [*heads], ValueError)
    field, key = heads[head]
    if key and field == "params":
        _check_kind(problem, key)
    place = Place(name, field, key, index)
    shape = place.array(problem).shape
    if not index and np.prod(shape) == 1:
        return place._replace(entry=(0,) * len(shape))
    if len(index) != len(shape) or any(i >= size for i, size in zip(index, shape, strict=True)):
        raise ValueError(f"parameters must name {_entries(head, shape)} of {problem.name}, not {name}.")
    return place


def _heads(problem: Problem) -> dict[str, tuple[str, str]]:
    """Return the field and the key of each name; a parameter named u0 takes precedence over the initial value."""
    heads = {"u0": ("u0", ""), "v0": ("v0", "")}
    if problem.unknowns.is_read:
        heads |= {("z0" if name == UNNAMED else name): ("z0", name) for name in problem.z0}
    layout = getattr(problem.params, "layout", None)
    if layout is not None:
        return {**heads, **{name: ("params", name) for name in layout.names}}
    return {**({_FLAT: ("params", "")} if check_params(problem.params).size else {}), **heads}


def _check_kind(problem: Problem, key: str) -> None:
    layout = problem.params.layout
    kind = layout.kinds[layout.names.index(key)]
    if kind.ndim < 0:
        raise TypeError(f"{key} is a sparse matrix, which has no derivative here: let rhs read a factor of it instead.")
    if kind.is_whole:
        raise TypeError(f"{key} is a whole number in the parameters: write it as a real one, such as 2.0 for 2.")


def _entries(head: str, shape: tuple[int, ...]) -> str:
    if not shape:
        return f"{head} without an index"
    if np.prod(shape) == 1:
        return head
    first, last = (", ".join(map(str, index)) for index in (np.zeros_like(shape), np.array(shape) - 1))
    return f"an entry {head}[{first}] to {head}[{last}]"
