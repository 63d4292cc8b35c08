"""The source of what a structure has many of, rows of matrices and links: as loops, or line by line.

Loops compile once for structures of all sizes. The lanes of an ensemble need straight lines: LLVM does not vectorise a
loop over members around loops whose bounds it does not know.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..kernels.compile.source import Writer

Ends: TypeAlias = list[tuple[str, str]]  # the two ends of a link in each of its directions


class Pattern(NamedTuple):
    """The whole numbers of a structure that is written line by line.

    Attributes
    ----------
    n : int
        The number of degrees of freedom.
    columns : tuple of (str, tuple)
        For each matrix its name, and the columns of the entries of each row; entries are blocks.
    ends : tuple of tuple
        For each kind of links, each link and each of its directions, the two ends.
    samples : tuple of (str, int)
        The names and the lengths of the times of records.
    degrees : tuple of int
        The degrees of freedom of a table of forces.
    modes : int
        The number of damped modes.
    """

    n: int
    columns: tuple[tuple[str, tuple[tuple[int, ...], ...]], ...]
    ends: tuple[tuple[tuple[tuple[int, int], ...], ...], ...]
    samples: tuple[tuple[str, int], ...]
    degrees: tuple[int, ...]
    modes: int


def axes_of(directions: int) -> Sequence[str]:
    """Return the ends of the names of what a link has in each of its directions."""
    return ("",) if directions == 1 else [f"_{k}" for k in range(directions)]


def number_of_links(k: int, directions: int) -> str:
    """Return the text of the number of links of a kind."""
    return f"p.link_{k}_first.size" if directions == 1 else f"p.link_{k}_first.shape[0]"


def pattern_of(has: dict[str, Any]) -> Pattern:
    """Return the pattern of a structure with these parameters."""
    columns: list[tuple[str, tuple[tuple[int, ...], ...]]] = []
    ends: list[tuple[tuple[tuple[int, int], ...], ...]] = []
    for name in "KC":
        if name in has:
            A = has[name]
            rows = np.split(np.asarray(A.indices), A.indptr[1:-1])
            columns.append((name, tuple(tuple(row.tolist()) for row in rows)))
    while f"link_{len(ends)}_first" in has:
        first, second = (np.asarray(has[f"link_{len(ends)}_{end}"]) for end in ("first", "second"))
        pairs = np.stack([first, second], axis=-1).reshape(len(first), -1, 2).tolist()
        ends.append(tuple(tuple((i, j) for i, j in link) for link in pairs))
    samples = ((name, len(value)) for name, value in has.items() if name in ("ground_times", "force_times"))
    modes, degrees = len(has.get("modes", ())), np.asarray(has.get("degrees", ())).tolist()
    return Pattern(has["size"], tuple(columns), tuple(ends), tuple(samples), tuple(degrees), modes)


@dataclass(frozen=True)
class Loops:
    """Source with loops. `edge` is the number of rows of a block."""

    edge: int
    n, modes = "p.size", "p.modes.shape[0]"

    def begin_forces(self, out: Writer, function: str) -> None:
        """Set the forces on single degrees of freedom to 0, or to the forces of the user's function."""
        with out.block("for i in range(a.size)"):
            out.line("a[i] = 0.0")
        out.line(*[function] * bool(function))

    def force(self, end: str) -> str:
        """Return the text of the force on a degree of freedom."""
        return f"a[{end}]"

    def rows(self, out: Writer) -> Iterator[str]:
        """Write what follows for each row of blocks, and give the text of the row."""
        with out.block(f"for row in range(n // {self.edge})"):
            yield "row"

    def rows_of_threads(self, out: Writer, threads: int) -> Iterator[str]:
        """Write what follows for each row of blocks, if threads share the rows."""
        out.line(f"rows = n // {self.edge}")
        share = f"part * rows // {threads}, (part + 1) * rows // {threads}"
        with out.block(f"for part in prange({threads})"), out.block(f"for row in range({share})"):
            yield "row"

    def at(self, row: str, k: int) -> str:
        """Return the text of the degree of freedom k of a row of blocks."""
        return row if self.edge == 1 else f"{self.edge} * {row} + {k}"

    def product(self, out: Writer, name: str, row: str, x: str, has_rate: bool = False) -> list[str]:
        """Write the product of a row of blocks of a matrix and x or, with a rate, x + rate v; return its entries."""
        function, further = ("stiff", ", rate, v") if has_rate else ("product", "")
        out.line(f"{name}_{x} = {function}({name}_data, {name}_indices, {name}_indptr, {row}, {x}{further})")
        return [f"{name}_{x}[{k}]" for k in range(self.edge)]

    def links(self, out: Writer, k: int, directions: int) -> Iterator[tuple[str, Ends]]:
        """Write what follows for each link of a kind, and give the texts of its number and its ends."""
        with out.block(f"for s in range({number_of_links(k, directions)})"):
            yield "s", self.ends(out, k, directions)

    def ends(self, out: Writer, k: int, directions: int) -> Ends:
        """Write the ends of the link s, and return their texts for each direction."""
        axes = axes_of(directions)
        for number, axis in enumerate(axes):
            at = f"s, {number}" if axis else "s"
            out.line(f"i{axis}, j{axis} = p.link_{k}_first[{at}], p.link_{k}_second[{at}]")
        return [(f"i{axis}", f"j{axis}") for axis in axes]

    def is_free(self, end: str) -> str:
        """Return the text of the condition that the end of a link is not the ground."""
        return f"{end} >= 0"

    def loads(self, out: Writer) -> Iterator[tuple[str, str]]:
        """Write what follows for each load of a table, and give the texts of its number and degree of freedom."""
        with out.block("for k in range(p.degrees.size)"):
            yield "k", "p.degrees[k]"

    def sample(self, out: Writer, times: str) -> str:
        """Write the place in a record and the elapsed fraction of its interval; return when t is within the record."""
        out.line(f"place, part = weight(t, p.{times})")
        return "place >= 0"


@dataclass(frozen=True)
class Lines:
    """Source line by line, with the methods of `Loops`."""

    edge: int
    pattern: Pattern

    @property
    def n(self) -> str:
        return str(self.pattern.n)

    @property
    def modes(self) -> str:
        return str(self.pattern.modes)

    def begin_forces(self, out: Writer, function: str) -> None:
        # LLVM does not vectorise a loop that changes the same entry of an array several times
        every = range(self.pattern.n)
        if function:
            out.line(*(f"a[{i}] = 0.0" for i in every), function)
        out.line(*(f"force_{i} = {f'a[{i}]' if function else '0.0'}" for i in every))

    def force(self, end: str) -> str:
        return f"force_{end}"

    def rows(self, out: Writer) -> Iterator[str]:
        yield from map(str, range(self.pattern.n // self.edge))

    def at(self, row: str, k: int) -> str:
        return str(self.edge * int(row) + k)

    def product(self, out: Writer, name: str, row: str, x: str, has_rate: bool = False) -> list[str]:
        edge, columns = self.edge, dict(self.pattern.columns)[name]
        first, sums = sum(map(len, columns[: int(row)])), []
        for i in range(edge):
            terms = []
            for b, column in enumerate(columns[int(row)], first):
                for j in range(edge):
                    at = edge * column + j
                    value = f"({x}[{at}] + rate * v[{at}])" if has_rate else f"{x}[{at}]"
                    terms.append(f"{name}_data[{edge * edge * b + edge * i + j}] * {value}")
            sums.append(f"({' + '.join(terms) or '0.0'})")
        return sums

    def links(self, out: Writer, k: int, directions: int) -> Iterator[tuple[str, Ends]]:
        for s, link in enumerate(self.pattern.ends[k]):
            yield str(s), [(str(i) if i >= 0 else "", str(j) if j >= 0 else "") for i, j in link]

    def is_free(self, end: str) -> str:
        return ""

    def loads(self, out: Writer) -> Iterator[tuple[str, str]]:
        yield from ((str(k), str(degree)) for k, degree in enumerate(self.pattern.degrees))

    def sample(self, out: Writer, times: str) -> str:
        """Write it without branches: powers of two are added to the place as long as its time is not later than t."""
        last = dict(self.pattern.samples)[times] - 1
        out.line(f"times, place = p.{times}, 0")
        for step in (2**k for k in reversed(range(last.bit_length()))):
            later = f"min(place + {step}, {last})"
            out.line(f"place = place + {step} if (place + {step} < {last}) & (times[{later}] <= t) else place")
        out.line("part = (t - times[place]) / (times[place + 1] - times[place])")
        return f"(times[0] <= t) & (t <= times[{last}])"
