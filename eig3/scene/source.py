"""The source of a scene, its parameters in one array p, and the names of parameters and functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..functions.records import Table
from ..kernels.compile.source import Writer
from .assembly import EVENT, STATE, Assembly
from .box_text import BoxText
from .effect import RATE, Effect, arguments
from .names import identifier, words
from .placed import Placed


@dataclass(frozen=True)
class Column:
    """The place of a parameter in p.

    p contains one value if all members have the same value, and otherwise one value for each member; for a vector, this
    holds for each component. A component that is 0 in all members is written as 0.0 in the source, and the compiler
    removes it. This is not done if all components of an effect's vector are 0, because the code of an effect must not
    depend on its parameters.
    """

    offset: int
    members: int
    zero: tuple[bool, ...] | None = None  # for each component of a vector, whether it is 0; None for numbers

    @property
    def is_uniform(self) -> bool:
        return self.members == 1

    def of(self, member: str) -> str:
        """Return the source of a member's number or tuple."""
        if self.zero is None:
            return self._entry(0, member)
        return f"({', '.join(self.component(k, member) for k in range(len(self.zero)))},)"

    def component(self, k: int, member: str) -> str:
        """Return the source of one component of a member's vector."""
        return "0.0" if self.zero and self.zero[k] else self._entry(k, member)

    def _entry(self, k: int, member: str) -> str:
        offset = self.offset + k * self.members
        if self.is_uniform:
            return f"p[{offset}]"
        return entry("p", offset, member)


@dataclass(frozen=True)
class ArrayOrState:
    """The place of an array in p, or of a state in u: the source for each member.

    `place` has the two ends of an array in p, or the places in p of the begins and of the ends of several arrays, and
    whether these are several.
    """

    of: Callable[[str], str]
    is_uniform: bool
    place: tuple[int, int, bool] | None = None


def entry(array: str, offset: int, index: str) -> str:
    """Return the source of array[offset + index]."""
    if index.isdecimal():
        return f"{array}[{offset + int(index)}]"
    return f"{array}[{offset} + {index}]" if offset else f"{array}[{index}]"


@dataclass(frozen=True, eq=False)
class Symbols:
    """A law in the source: its functions and its parameters.

    Attributes
    ----------
    effect : Effect
    functions : dict of str to jitted function
    columns : dict of str to Column or ArrayOrState
    members : int
        The number of motions in the law; 1 for other effects.
    names : dict of str to str
        The names in the source of functions, as "force()", of parameters with one value for all members, and, as
        "=force", of results.
    events : ndarray of int
        The number of each member's event; empty for an effect without an event.
    """

    effect: Effect
    functions: dict[str, Any]
    columns: dict[str, Column | ArrayOrState]
    members: int
    names: dict[str, str]
    events: np.ndarray

    def reads(self, name: str, *functions: str) -> bool:
        """Return whether one of these functions has an argument of this name."""
        return any(name in arguments(self.functions[f]) for f in functions if f in self.functions)

    def constants(self, *functions: str) -> Iterator[str]:
        """Return assignments of the parameters of these functions with one value for all members."""
        for name, column in self.columns.items():
            if column.is_uniform and (name == self.effect.cutoff_field or self.reads(name, *functions)):
                yield f"{self.names[name]} = {column.of('')}"

    def call(self, function: str, member: str, offered: dict[str, str]) -> str:
        """Return the source of a call for one member; `offered` has the source of arguments that are not parameters."""
        needed = arguments(self.functions[function])
        values = (self.value(name, member) if name in self.columns else offered[name] for name in needed)
        return f"{self.names[f'{function}()']}({', '.join(values)})"

    def value(self, name: str, member: str) -> str:
        """Return the source of one member's parameter."""
        column = self.columns[name]
        return self.names[name] if column.is_uniform else column.of(member)


class Source(Writer):
    """The source of one scene, and its array p.

    Attributes
    ----------
    size : int
        The size of p so far.
    functions : dict of str to jitted function
        The functions by their names in the source.
    weight : Column
        Inverse masses.
    turn : Column or None
        Inverse inertias, 0 for masses without inertia; None if no mass has an inertia.
    motions : list of Symbols
    box : BoxText
    team : int or None
        The place of the team of threads that share the pair forces; None if `threads` is not given, or the scene is
        small.
    records : list of (tuple, tuple)
        The `ArrayOrState.place` of the times and the values of each motion with a record.
    left_out : list of int
        The places in p of the components that are 0 in all members.
    cutoffs : list of (int, int, float)
        See `Cutoffs`.
    is_of_part : bool
        Whether the current lines are for the masses of a part, from low to end.
    """

    def __init__(self, assembly: Assembly) -> None:
        super().__init__()
        self._parts: list[np.ndarray] = []
        self.size = 0
        self.left_out: list[int] = []
        self.cutoffs: list[tuple[int, int, float]] = []
        self._wanted: list[str] = []  # names, by the numbers that replace them until the source is written
        self.functions: dict[str, Any] = {}
        self._first_state, self._first_rate, cloud = assembly.coordinates, assembly.degrees, assembly.cloud
        self.weight = self.column(1 / cloud.in_order(cloud.masses))
        self.turn = self.column(_inverse(cloud.in_order(cloud.inertia))) if assembly.angles else None
        self.motions = [self.symbols(law) for law in assembly.motions]
        sides = {axis: self.add(side) for axis, side in zip("xyz", cloud.box, strict=False) if side > 0}
        self.box = BoxText(sides, self.add(np.array(cloud.shear)) if cloud.shear else None)
        self.team: int | None = None
        self.is_of_part = False
        motions: list[Any] = [motion for motion in self.motions if motion.effect._record]  # type: ignore[attr-defined]
        self.records = [tuple(motion.columns[name].place for name in motion.effect._record) for motion in motions]

    @property
    def params(self) -> np.ndarray:
        """The array p."""
        return np.concatenate(self._parts)

    def add(self, values: np.ndarray) -> int:
        """Append to p; return the place."""
        self._parts.append(np.ravel(values).astype(np.float64))
        self.size += self._parts[-1].size
        return self.size - self._parts[-1].size

    def column(self, values: np.ndarray, is_place: bool = False) -> Column:
        """Append a parameter of members to p."""
        if (values == values[0]).all():
            values = values[:1]
        zero = None
        if values.ndim == 2:
            is_zero = (values == 0).all(axis=0)
            zero = tuple((is_zero & (is_place or not is_zero.all())).tolist())
        offset, count = self.add(values.T), len(values)
        self.left_out += [
            offset + k * count + s for k, is_zero in enumerate(zero or ()) if is_zero for s in range(count)
        ]
        return Column(offset, count, zero)

    def symbols(self, law: Placed) -> Symbols:
        """Append the parameters of a law to p, and name its functions."""
        effect, functions = law.effect, law.effect.functions()
        columns: dict[str, Any] = {
            name: self._array(values) if name in effect.arrays else self.column(values)
            for name, values in law.columns.items()
            if name not in (EVENT, STATE)
        }
        if effect.cutoff_field in columns:
            cutoff = columns[effect.cutoff_field]
            self.cutoffs.append((cutoff.offset, cutoff.offset + cutoff.members, 1.0))
        if STATE in law.columns:
            has_rate = RATE in functions
            begin, number = self._numbers(law.columns[STATE])
            array, first = ("v", self._first_rate) if has_rate else ("u", self._first_state)
            first, size = first + begin, effect.state_size
            columns[STATE] = ArrayOrState(lambda member: state(array, first, number(member), size), False)
            if has_rate:
                columns[RATE] = ArrayOrState(lambda member: state("a", first, number(member), size), False)
        members = len(law.columns["direction"]) if "direction" in law.columns else 1
        stem = words(effect.title).replace(" ", "_")
        names = {f"{function}()": self._name(f"{stem}_{function}") for function in functions}
        names |= {name: self._name(f"{stem}_{name}") for name in columns}
        names |= {f"={function}": self._name(f"{stem}_{function[0]}") for function in functions}
        self.functions.update({names[f"{name}()"]: function for name, function in functions.items()})
        events = law.columns.get(EVENT, np.empty(0, dtype=np.int64))
        return Symbols(effect, functions, columns, members, names, events)

    def _array(self, values: np.ndarray | list[np.ndarray]) -> ArrayOrState:
        if not isinstance(values, list):
            offset = self.add(values)
            place = offset, offset + values.size, False
            return ArrayOrState(lambda member: f"p[{offset}:{offset + values.size}]", True, place)
        first = np.array([self.add(array) for array in values])
        starts, ends = self.column(first), self.column(first + [array.size for array in values])
        place = starts.offset, ends.offset, True
        return ArrayOrState(lambda member: f"p[index({starts.of(member)}) : index({ends.of(member)})]", False, place)

    def _numbers(self, numbers: np.ndarray) -> tuple[int, Callable[[str], str]]:
        """Return where numbers of members begin, and the source of a member's distance from there.

        Evenly spaced numbers are not in p: lanes can only be vectorised if their places are known.
        """
        begin, step = int(numbers[0]), int(np.diff(numbers[:2]).sum())
        if (numbers == begin + step * np.arange(numbers.size)).all():
            return begin, lambda member: "0" if step == 0 or member == "0" else f"{step} * {member}"
        column = self.column(numbers)
        return 0, lambda member: f"index({column.of(member)})"

    def _name(self, wanted: str) -> str:
        """Return a placeholder in the source, which `named` replaces by a name similar to `wanted`."""
        self._wanted.append(wanted)
        return f"${len(self._wanted) - 1}"

    def named(self) -> tuple[str, dict[str, Any]]:
        """Return the source with unique names, and its functions by their names."""
        source = str(self)
        taken, names = {*re.findall(r"\w+", source), *self.functions}, dict[str, str]()
        for number, wanted in enumerate(self._wanted):
            names[f"${number}"] = identifier(wanted, taken)
            taken.add(names[f"${number}"])
        functions = {names.get(name, name): function for name, function in self.functions.items()}
        return re.sub(r"\$\d+", lambda found: names[found[0]], source), functions


def tables(places: Sequence[tuple], rows: np.ndarray, layout: Any) -> list[Table]:
    """Return the records of motions in the parameters of members, less their first values; see `Records`."""
    found = []
    for pair in places:
        for times, values in zip(*(_slices(place, rows[0]) for place in pair), strict=True):
            found.append((rows[:, times], rows[:, values] - rows[:, values][:, :1]))
    return found


def _slices(place: tuple[int, int, bool], p: np.ndarray) -> list[slice]:
    """Return the arrays at an `ArrayOrState.place`."""
    begin, end, are_several = place
    if not are_several:
        return [slice(begin, end)]
    return [slice(*ends) for ends in p[begin : 2 * end - begin].astype(int).reshape(2, -1).T.tolist()]


def state(array: str, first: int, number: str, size: int) -> str:
    """Return the source of a state of `size` numbers, a tuple if there are several: also what an assignment changes."""
    entries = [entry(array, first + k, number) for k in range(size)]
    return entries[0] if size == 1 else f"({', '.join(entries)})"


def _inverse(values: np.ndarray) -> np.ndarray:
    """Return the inverses of numbers, and 0 for 0."""
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0)
