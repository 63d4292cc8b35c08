"""The code of a scene: Python source with a loop for each group of effects and nothing else, compiled by Numba.

Source rather than closures, for three reasons: what is computed can be read, and by `inspect.getsource` is; loops over
the same points share what they compute of them; and scenes of one structure share one compiled function, whatever
their parameters.
"""

from __future__ import annotations

import functools
import linecache
import math
import re
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .assembly import Assembly, Group, Law
from .callbacks import jit
from .effect import arguments
from .kernels.jit import element

_AXES = "xyz"
_TINY = 2.0**-1000  # under a root, against a division by zero where points coincide: too small to change another value


@element
def index(x):  # type: ignore[no-untyped-def]
    """A number of p as an index; that it is not negative spares a test for indices from the end."""
    return np.int64(np.uint32(x))


class _Params:
    """The array p in the making."""

    def __init__(self) -> None:
        self._parts: list[np.ndarray] = []
        self._size = 0

    def add(self, values: Any) -> int:
        """Where the values begin."""
        offset = self._size
        self._parts.append(np.ravel(values).astype(np.float64))
        self._size += self._parts[-1].size
        return offset

    @property
    def values(self) -> np.ndarray:
        return np.concatenate([*self._parts, np.empty(0)])


class _Lines:
    """Source in the making."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._depth = 0

    def __call__(self, line: str) -> None:
        self._lines.append("    " * self._depth + line)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        self(head)
        self._depth += 1
        yield
        self._depth -= 1

    def __str__(self) -> str:
        return "\n".join(self._lines) + "\n"


def _grouped(terms: list[str]) -> str:
    """A sum that can be a factor."""
    total = " + ".join(terms)
    return f"({total})" if len(terms) > 1 or " - " in total else total


@dataclass(frozen=True)
class _Column:
    """Where a parameter is in p: once where all members have the same, else a value for each, by component.

    Components that are 0 in all members become 0.0 in the source, which the compiler leaves out; but not those of an
    effect's vector of which all are, since an effect that is named may be 0.
    """

    offset: int
    members: int
    zero: tuple[bool, ...] | None = None  # by component; None for numbers

    @property
    def is_uniform(self) -> bool:
        return self.members == 1

    def of(self, member: str) -> str:
        """The source of a member's number or tuple."""
        if self.zero is None:
            return self._entry(0, member)
        return f"({', '.join(self.component(k, member) for k in range(len(self.zero)))},)"

    def component(self, k: int, member: str) -> str:
        return "0.0" if self.zero and self.zero[k] else self._entry(k, member)

    def _entry(self, k: int, member: str) -> str:
        offset = self.offset + k * self.members
        if self.is_uniform or member.isdecimal():
            return f"p[{offset + int('0' if self.is_uniform else member)}]"
        return f"p[{offset} + {member}]" if offset else f"p[{member}]"


@dataclass(frozen=True)
class _Array:
    """Where an array is in p."""

    offset: int
    size: int
    is_uniform = True

    def of(self, member: str) -> str:
        return f"p[{self.offset}:{self.offset + self.size}]"


@dataclass(frozen=True)
class _Symbols:
    """A law in the source: the prefix of its names, and its parameters."""

    law: Law
    prefix: str
    columns: dict[str, _Column | _Array]

    def read(self, function: str) -> list[str]:
        """The parameters that a function reads."""
        return [name for name in arguments(self.law.effect.functions()[function]) if name in self.columns]

    def hoisted(self, *functions: str) -> Iterator[str]:
        """Assignments of what is the same for all members."""
        names = dict.fromkeys(name for f in functions if self.has(f) for name in self.read(f))
        for name in names:
            if self.columns[name].is_uniform:
                yield f"{self.prefix}_{name} = {self.columns[name].of('')}"

    def has(self, function: str) -> bool:
        return function in self.law.effect.functions()

    def call(self, function: str, member: str, offered: dict[str, str]) -> str:
        compiled = self.law.effect.functions()[function]
        return f"{self.prefix}_{function}({', '.join(self._value(a, member, offered) for a in arguments(compiled))})"

    def _value(self, name: str, member: str, offered: dict[str, str]) -> str:
        if name not in self.columns:
            return offered[name]
        column = self.columns[name]
        return f"{self.prefix}_{name}" if column.is_uniform else column.of(member)


@dataclass(frozen=True)
class _Block:
    """A group in the source: its laws, its fixed ends, and the runs of its indices."""

    group: Group
    laws: list[_Symbols]
    anchor: _Column | None
    runs: np.ndarray
    table: int  # where runs or indices are in p, if there is a table of them

    @property
    def size(self) -> int:
        return self.group.first.size

    @property
    def in_runs(self) -> bool:
        return self.group.in_runs

    @property
    def is_row(self) -> bool:
        """Whether every link joins neighbours."""
        return self.group.difference == 1

    def second(self) -> str:
        """The source of the second mass's index in a loop over runs: where i is, or in the table of runs."""
        return f"i + {self.group.difference}" if self.group.difference else "j0 + along"

    def reads(self, name: str, *functions: str) -> bool:
        """Whether one of the functions of a law names the argument."""
        return any(
            law.has(f) and name in arguments(law.law.effect.functions()[f]) for law in self.laws for f in functions
        )

    def has(self, *functions: str) -> bool:
        return any(law.has(f) for law in self.laws for f in functions)


def compiled(assembly: Assembly) -> tuple[Any, Any, np.ndarray]:
    """The right-hand side of a scene, its energy or None, and their parameters.

    Scenes that differ in parameters only get the same functions.
    """
    source = _Source(assembly)
    out = _Lines()
    if assembly.follows_work:
        out("@jit")
        source.power(out)
        out("")
    out("@jit")
    source.rhs(out)
    if assembly.follows_work or assembly.is_conservative:
        out("")
        out("@jit")
        source.energy(out)
    functions = _functions(str(out), tuple(source.names.items()))
    return functions["rhs"], functions.get("energy"), source.params.values


@functools.lru_cache(maxsize=256)
def _functions(text: str, names: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
    filename = f"<scene {zlib.crc32(text.encode()):08x}>"
    linecache.cache[filename] = (len(text), None, text.splitlines(keepends=True), filename)  # for inspect and errors
    namespace = {"jit": jit, **dict(names)}
    exec(compile(text, filename, "exec"), namespace)
    return namespace


class _Source:
    """Writes the functions of one scene.

    In the source, i and j are indices of masses, s that of a member of a group; w is an inverse mass; d, e are the
    distance of a link's ends and its rate by coordinate, r its length; f is the force on the first end.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.n, self.dimension = assembly.n, assembly.dimension
        self.axes = _AXES[: assembly.dimension]
        self.follows_work = assembly.follows_work
        self.params = _Params()
        self.names: dict[str, Any] = {"sqrt": math.sqrt, "index": index}
        self.weight = self._column(1 / assembly.cloud.masses[assembly.cloud.masses > 0])
        self.motions = [self._symbols(law) for law in assembly.motions]
        self.bodies = [self._block(group) for group in assembly.bodies]
        self.links = [self._block(group) for group in assembly.links]

    # What goes into p and into the names of the source

    def _column(self, values: np.ndarray, is_place: bool = False) -> _Column:
        if (values == values[0]).all():
            values = values[:1]
        zero = tuple((values == 0).all(axis=0).tolist()) if values.ndim == 2 else None
        if zero and all(zero) and not is_place:
            zero = (False,) * len(zero)
        return _Column(self.params.add(values.T), len(values), zero)

    def _symbols(self, law: Law) -> _Symbols:
        effect = law.effect
        stem = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(effect).__name__).lower()
        prefixes = (stem, *(f"{stem}_{k}" for k in range(2, len(self.names) + 3)))
        functions = effect.functions()
        prefix = next(x for x in prefixes if not any(f"{x}_{name}" in self.names for name in functions))
        self.names.update({f"{prefix}_{name}": function for name, function in functions.items()})
        columns = {
            name: _Array(self.params.add(values), values.size) if name in effect.arrays else self._column(values)
            for name, values in law.columns.items()
        }
        return _Symbols(law, prefix, columns)

    def _block(self, group: Group) -> _Block:
        runs = group.runs()
        block = _Block(group, [self._symbols(law) for law in group.laws], None, runs, 0)
        anchor = None if group.anchor is None else self._column(group.anchor, is_place=True)
        if block.in_runs:
            table = self.params.add(runs) if len(runs) > 1 else 0
        else:
            second = group.first if group.second is None else group.second
            table = self.params.add(np.concatenate([group.first, second])) if block.size > 1 else 0
        return replace(block, anchor=anchor, table=table)

    # Pieces of source

    def _at(self, array: str, axis: str, i: str) -> str:
        """A mass's entry in u, v or a."""
        offset = self.n * self.axes.index(axis)
        if i.isdecimal():
            return f"{array}[{offset + int(i)}]"
        return f"{array}[{offset} + {i}]" if offset else f"{array}[{i}]"

    def _w(self, i: str) -> str:
        return "w" if self.weight.is_uniform else self.weight.of(i)

    @property
    def _common(self) -> str:
        """What the forces of links are multiplied by at once where all masses are equal."""
        return "w" if self.weight.is_uniform else ""

    def _own(self, i: str) -> str:
        """What they are multiplied by at each mass where they are not."""
        return "" if self.weight.is_uniform else f" * {self._w(i)}"

    @contextmanager
    def _over_masses(self, out: _Lines, start: int, stop: int) -> Iterator[str]:
        if stop - start == 1:
            yield str(start)
            return
        with out.block(f"for i in range({start}, {stop}):"):
            yield "i"

    @contextmanager
    def _over_members(self, out: _Lines, block: _Block) -> Iterator[tuple[str, str, str]]:
        """A loop over a group: yields the source of the member's index, and of its two masses'."""
        both = block.group.second is not None
        if block.size == 1:
            yield "0", str(block.runs[0, 2]), str(block.runs[0, 3])
        elif block.in_runs and len(block.runs) == 1:
            _, count, i, j = block.runs[0]
            with out.block(f"for s in range({count}):"):
                out(f"i, j = {i} + s, {j} + s" if both else f"i = {i} + s")
                yield "s", "i", "j"
        elif block.in_runs:
            with self._over_runs(out, block), self._along_run(out, block) as indices:
                yield indices
        else:
            with out.block(f"for s in range({block.size}):"):
                out(f"i = index(p[{block.table} + s])")
                if both:
                    out(f"j = index(p[{block.table + block.size} + s])")
                yield "s", "i", "j"

    @contextmanager
    def _over_runs(self, out: _Lines, block: _Block) -> Iterator[None]:
        with out.block(f"for k in range({block.table}, {block.table + block.runs.size}, 4):"):
            out("start, count, i0, j0 = index(p[k]), index(p[k + 1]), index(p[k + 2]), index(p[k + 3])")
            yield

    @contextmanager
    def _along_run(self, out: _Lines, block: _Block) -> Iterator[tuple[str, str, str]]:
        with out.block("for along in range(count):"):
            out("s = start + along")
            out("i = i0 + along")
            if block.group.second is not None:
                out(f"j = {block.second()}")
            yield "s", "i", "j"

    def _hoist(self, out: _Lines, blocks: Iterable[_Block], *functions: str) -> None:
        for block in blocks:
            for law in block.laws:
                for line in law.hoisted(*functions):
                    out(line)
            if block.anchor and block.anchor.is_uniform:
                for axis in self.axes:
                    out(f"anchor_{axis} = {block.anchor.component(self.axes.index(axis), '')}")

    def _body(self, out: _Lines, block: _Block, member: str, i: str, *functions: str) -> dict[str, str]:
        """What the functions of a body's laws are offered, written where one of them reads it."""
        if block.reads("x", *functions):
            out(f"x = ({', '.join(self._at('u', axis, i) for axis in self.axes)},)")
        if block.reads("v", *functions) or "power" in functions:
            out(f"velocity = ({', '.join(self._at('v', axis, i) for axis in self.axes)},)")
        if block.reads("m", *functions) or ("power" in functions and block.has("acceleration")):
            out(f"m = 1 / {self._w(i)}")
        return {"t": "t", "x": "x", "v": "velocity", "m": "m"}

    def _accelerations(
        self, out: _Lines, blocks: list[tuple[_Block, str]], i: str, *more: str
    ) -> tuple[list[str], list[str]]:
        """Names of the accelerations and of the forces that body laws give to mass i."""
        accelerations, forces = [], []
        for block, member in blocks:
            offered = self._body(out, block, member, i, "force", "acceleration", *more)
            for law in block.laws:
                for function, names in (("force", forces), ("acceleration", accelerations)):
                    if law.has(function):
                        names.append(f"{law.prefix}_{function[0]}")
                        out(f"{names[-1]} = {law.call(function, member, offered)}")
        return accelerations, forces

    def _sum(self, axis: str, accelerations: list[str], forces: list[str], links: str, i: str) -> str:
        """The acceleration along an axis, from names of tuples and a term of the links' force."""
        k = self.axes.index(axis)
        terms = [f"{name}[{k}]" for name in accelerations]
        pushed = [f"{name}[{k}]" for name in forces]
        (terms if self.weight.is_uniform else pushed).extend([links] * bool(links))
        if pushed:
            terms.append(f"{_grouped(pushed)} * {self._w(i)}")
        return " + ".join(terms) or "0.0"

    def _geometry(self, out: _Lines, block: _Block, member: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """What a link's laws need of its ends, written where one of them reads it."""
        needs_rate = block.reads("rate", *functions) or "power" in functions
        needs_r = block.reads("r", *functions) or needs_rate or ("tension" in functions and block.has("tension"))
        for axis in self.axes:
            out(f"d{axis} = {self._difference('u', block, axis, member, i, j)}")
            if needs_rate:
                out(f"e{axis} = {self._difference('v', block, axis, member, i, j)}")
        if self.dimension == 1:
            return {"t": "t", "r": "dx", "rate": "ex"}
        if needs_r:
            out(f"r = sqrt({_TINY!r} + {' + '.join(f'd{axis} * d{axis}' for axis in self.axes)})")
        if needs_rate or (block.has("tension") and "tension" in functions):
            out("inverse = 1 / r")
        if needs_rate:
            out(f"rate = ({' + '.join(f'd{axis} * e{axis}' for axis in self.axes)}) * inverse")
        return {"t": "t", "r": "r", "rate": "rate"}

    def _difference(self, array: str, block: _Block, axis: str, member: str, i: str, j: str) -> str:
        """Of the two ends' positions or velocities, along an axis."""
        if block.anchor is None:
            low, high = self._at(array, axis, i), self._at(array, axis, j)
        else:
            low, high = self._support(array, block, axis, member), self._at(array, axis, i)
        if block.group.sign < 0:
            low, high = high, low
        if low == "0.0":
            return high
        return f"-{low}" if high == "0.0" else f"{high} - {low}"

    def _support(self, array: str, block: _Block, axis: str, member: str) -> str:
        """The position or velocity of a fixed end, along an axis."""
        terms = []
        if array == "u" and block.anchor.component(self.axes.index(axis), member) != "0.0":
            terms.append(
                f"anchor_{axis}" if block.anchor.is_uniform else block.anchor.component(self.axes.index(axis), member)
            )
        for number in block.group.motions:
            if self._direction(number, axis) != "0.0":
                terms.append(f"{'shift' if array == 'u' else 'speed'}_{number}_{axis}")
        if not terms:
            return "0.0"
        return terms[0] if len(terms) == 1 else f"({' + '.join(terms)})"

    def _direction(self, number: int, axis: str) -> str:
        return self.motions[number].columns["direction"].component(self.axes.index(axis), "")

    def _pull(self, out: _Lines, block: _Block, member: str, i: str, j: str, weight: str = "") -> None:
        """The force on the first end, along each axis; times a weight, if one is given."""
        offered = self._geometry(out, block, member, i, j, "tension", "density")
        tensions = [law.call("tension", member, offered) for law in block.laws if law.has("tension")]
        densities = [law.call("density", member, offered) for law in block.laws if law.has("density")]
        times_w = f" * {weight}" if weight else ""
        if self.dimension == 1:
            terms = tensions + [f"{density} * dx" for density in densities]
            out(f"fx = {'-' if block.group.sign < 0 else ''}{_grouped(terms)}{times_w}")
            return
        if tensions:
            densities.append(f"{_grouped(tensions)} * inverse")
        out(f"pull = {_grouped(densities)}{times_w}")
        for axis in self.axes:
            out(f"f{axis} = pull * d{axis}")

    def _moved(self, out: _Lines, blocks: Iterable[_Block]) -> None:
        """The motions of supports that links stand on."""
        for number in sorted({number for block in blocks for number in block.group.motions}):
            motion = self.motions[number]
            for line in motion.hoisted("motion"):
                out(line)
            out(f"shift, speed = {motion.call('motion', '', {'t': 't'})}")
            for axis in (axis for axis in self.axes if self._direction(number, axis) != "0.0"):
                for name in ("shift", "speed"):
                    out(f"{name}_{number}_{axis} = {name} * {self._direction(number, axis)}")

    # The functions

    def rhs(self, out: _Lines) -> None:
        with out.block("def rhs(t, u, v, p, a):"):
            if self.weight.is_uniform:
                out(f"w = {self.weight.of('')}")
            self._moved(out, self.links)
            on_all = [block for block in self.bodies if block.size == self.n and len(block.runs) == 1]
            rows = [block for block in self.links if block.is_row and len(block.runs) == 1 and block.size > 1]
            row = max(rows, key=lambda block: block.size, default=None)
            self._hoist(out, [*on_all, *([row] if row else [])], "force", "acceleration", "tension", "density")
            self._masses(out, on_all, row)
            for block in self.bodies:
                if block not in on_all:
                    self._on_some(out, block)
            for block in self.links:
                if block is not row:
                    self._hoist(out, [block], "tension", "density")
                    self._between(out, block)
            if self.follows_work:
                out(f"a[{self.n * self.dimension}] = power(t, u, v, p)")

    def _masses(self, out: _Lines, on_all: list[_Block], row: _Block | None) -> None:
        """Every acceleration once: from what acts on all masses and, in the same pass, the longest row of links."""
        start, stop = (row.runs[0, 2], row.runs[0, 2] + row.size + 1) if row else (self.n, self.n)
        for first, last in ((0, start), (stop, self.n)):
            if first < last:
                with self._over_masses(out, first, last) as i:
                    self._assign(out, on_all, i, dict.fromkeys(self.axes, ""))
        if row:
            self._before(out)
            with out.block(f"for s in range({row.size}):"):
                out(f"i, j = {start} + s, {start + 1} + s")
                self._pull(out, row, "s", "i", "j", self._common)
                self._assign(out, on_all, "i", {axis: f"f{axis} - before_{axis}" for axis in self.axes})
                self._keep(out)
            self._assign(out, on_all, str(stop - 1), {axis: f"-before_{axis}" for axis in self.axes})

    def _before(self, out: _Lines) -> None:
        """A row keeps the force of its last link for the mass that the next shares with it."""
        out(f"{' = '.join(f'before_{axis}' for axis in self.axes)} = 0.0")

    def _keep(self, out: _Lines) -> None:
        for axis in self.axes:
            out(f"before_{axis} = f{axis}")

    def _assign(self, out: _Lines, on_all: list[_Block], i: str, links: dict[str, str]) -> None:
        accelerations, forces = self._accelerations(out, [(block, i) for block in on_all], i)
        for axis in self.axes:
            out(f"{self._at('a', axis, i)} = {self._sum(axis, accelerations, forces, links[axis], i)}")

    def _on_some(self, out: _Lines, block: _Block) -> None:
        self._hoist(out, [block], "force", "acceleration")
        with self._over_members(out, block) as (s, i, _):
            accelerations, forces = self._accelerations(out, [(block, s)], i)
            for axis in self.axes:
                out(f"{self._at('a', axis, i)} += {self._sum(axis, accelerations, forces, '', i)}")

    def _between(self, out: _Lines, block: _Block) -> None:
        if block.is_row and block.in_runs and len(block.runs) > 1:
            self._rows(out, block)
            return
        with self._over_members(out, block) as (s, i, j):
            self._pull(out, block, s, i, j, self._common)
            for axis in self.axes:
                if block.anchor is None:
                    out(f"{self._at('a', axis, i)} += f{axis}{self._own(i)}")
                    out(f"{self._at('a', axis, j)} -= f{axis}{self._own(j)}")
                else:
                    out(f"{self._at('a', axis, i)} -= f{axis}{self._own(i)}")

    def _rows(self, out: _Lines, block: _Block) -> None:
        with self._over_runs(out, block):
            self._before(out)
            with self._along_run(out, block) as (s, i, j):
                self._pull(out, block, s, i, j, self._common)
                for axis in self.axes:
                    out(f"{self._at('a', axis, i)} += (f{axis} - before_{axis}){self._own(i)}")
                self._keep(out)
            out("i = i0 + count")
            for axis in self.axes:
                out(f"{self._at('a', axis, 'i')} -= before_{axis}{self._own('i')}")

    def power(self, out: _Lines) -> None:
        """What is done to the masses by all that has no potential, and by the supports."""
        with out.block("def power(t, u, v, p):"):
            if self.weight.is_uniform:
                out(f"w = {self.weight.of('')}")
            self._moved(out, self.links)
            out("total = 0.0")
            for block in self._some(self.bodies, has_potential=False):
                self._hoist(out, [block], "force", "acceleration")
                with self._over_members(out, block) as (s, i, _):
                    accelerations, forces = self._accelerations(out, [(block, s)], i, "power")
                    for name in forces:
                        out(f"total += {self._with_velocity(name)}")
                    for name in accelerations:
                        out(f"total += m * ({self._with_velocity(name)})")
            for block in self._some(self.links, has_potential=False):
                self._hoist(out, [block], "tension", "density")
                with self._over_members(out, block) as (s, i, j):
                    offered = self._geometry(out, block, s, i, j, "tension", "density", "power")
                    tensions = [law.call("tension", s, offered) for law in block.laws if law.has("tension")]
                    tensions += [
                        f"{law.call('density', s, offered)} * {offered['r']}"
                        for law in block.laws
                        if law.has("density")
                    ]
                    out(f"total -= ({' + '.join(tensions)}) * {offered['rate']}")
            for block in (block for block in self.links if block.group.motions):
                self._hoist(out, [block], "tension", "density")
                with self._over_members(out, block) as (s, i, j):
                    self._pull(out, block, s, i, j)
                    for axis in self.axes:
                        out(f"total -= f{axis} * {self._support('v', block, axis, s)}")
            out("return total")

    def _some(self, blocks: list[_Block], *, has_potential: bool) -> Iterator[_Block]:
        """The blocks that have laws with a potential, or laws without, and only these laws of them."""
        for block in blocks:
            laws = [law for law in block.laws if law.has("potential") == has_potential]
            if laws:
                yield replace(block, laws=laws)

    def _with_velocity(self, name: str) -> str:
        """The product of a tuple with the velocity."""
        return " + ".join(f"{name}[{k}] * velocity[{k}]" for k in range(self.dimension))

    def energy(self, out: _Lines) -> None:
        """Kinetic energy and potentials, less the work where it is followed."""
        with out.block("def energy(t, u, v, p):"):
            if self.weight.is_uniform:
                out(f"w = {self.weight.of('')}")
            self._moved(out, self.links)
            out("total = 0.0")
            with self._over_masses(out, 0, self.n) as i:
                squares = " + ".join(f"{x} * {x}" for x in (self._at("v", axis, i) for axis in self.axes))
                out(f"total += ({squares}) / (2 * {self._w(i)})")
            for block in self._some(self.bodies, has_potential=True):
                self._hoist(out, [block], "potential")
                with self._over_members(out, block) as (s, i, _):
                    offered = self._body(out, block, s, i, "potential")
                    for law in block.laws:
                        out(f"total += {law.call('potential', s, offered)}")
            for block in self._some(self.links, has_potential=True):
                self._hoist(out, [block], "potential")
                with self._over_members(out, block) as (s, i, j):
                    offered = self._geometry(out, block, s, i, j, "potential")
                    for law in block.laws:
                        out(f"total += {law.call('potential', s, offered)}")
            if self.follows_work:
                out(f"total -= v[{self.n * self.dimension}]")
            out("return total")
