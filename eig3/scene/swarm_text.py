"""Write the loops over pairs of points that are near each other as lines of Python source.

In the source, point and mate are the places of two points in a list of neighbours, and i and j the indices of their
masses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from .assembly import Assembly
from .box_text import BoxText
from .packing import Packing, SwarmBlock, entry


class SwarmText:
    """The swarms of one scene in the source. Each method returns lines, with their indentation."""

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        self._n, self._axes, self._weight = assembly.n, "xyz"[: assembly.dimension], packing.weight
        self._box, self._swarms = BoxText(packing), packing.swarms

    def forces(self) -> Iterator[str]:
        """Add the forces between near points to the accelerations of their masses."""
        for block in self._swarms:
            yield from self._refreshed(block, "tension", "density")
            inside = [*self._point(block, self._reads_rate(block))]
            inside.append(f"{' = '.join(f'{axis}_sum' for axis in self._axes)} = 0.0")
            inside += self._mates(block, self._pull(block))
            inside += [f"{self._at('a', k, 'i')} += {axis}_sum * {self._w('i')}" for k, axis in enumerate(self._axes)]
            yield from self._points(block, inside)

    def potentials(self) -> Iterator[str]:
        """Add the potentials of near points to the total."""
        for block in self._swarms:
            if "potential" in block.law.functions:
                yield from self._refreshed(block, "potential")
                offered = self._offered(block)
                inside = ["r = sqrt(tiny + square)", f"total += {block.law.call('potential', '', offered)}"]
                yield from self._points(block, [*self._point(block, False), *self._mates(block, inside)])

    def power(self) -> Iterator[str]:
        """Add the power of the forces without a potential, and of the images in a box that shears."""
        for block in self._swarms:
            loses = "potential" not in block.law.functions
            if loses or self._box.shears:
                yield from self._refreshed(block, "tension", "density")
                inside = [*self._length(block, True), f"force = {self._tension(block)}"]
                inside += ["total -= force * rate"] * loses
                inside += ["fx = force * inverse * dx", *self._box.power()] if self._box.shears else []
                yield from self._points(block, [*self._point(block, True), *self._mates(block, inside)])

    def _refreshed(self, block: SwarmBlock, *functions: str) -> Iterator[str]:
        """Refresh the list, and read what all pairs share."""
        listing, areas = block.listing, block.listing.areas
        yield f"kept, place = memory(p), index({listing.place})"
        yield f"lists(REFRESH, {'t' if self._box.shears else '0.0'}, memory(u), kept, place, place, place)"
        yield f"places = floats(kept, {areas.x}, {len(self._axes) * listing.points})"
        yield f"above = integers(kept, {areas.above}, {listing.masses})"
        yield f"stops = integers(kept, {areas.stop}, {listing.masses})"
        yield f"mates = integers(kept, {areas.mates}, {listing.room})"
        if listing.begin < 0:
            yield f"indices = integers(kept, {areas.number}, {listing.masses})"
        yield from block.law.constants(*functions)

    def _points(self, block: SwarmBlock, inside: Iterable[str]) -> Iterator[str]:
        """Loop over the masses of the list, which has the pairs of some of them at a time if it has no room for all."""
        listing = block.listing
        yield "stop = index(0)"
        yield f"while stop < {listing.masses}:"
        yield f"    begin, stop = stop, index(lists(REACH, 0.0, kept, kept, place, stop, index({listing.masses})))"
        yield "    for point in range(begin, stop):"
        yield from (f"        {line}" for line in inside)

    def _point(self, block: SwarmBlock, reads_rate: bool) -> Iterator[str]:
        """Read the position of a point, and its velocity."""
        yield f"i = {self._mass(block, 'point')}"
        for k, axis in enumerate(self._axes):
            yield f"{axis}_here = {entry('places', k * block.listing.points, 'point')}"
            if reads_rate:
                yield f"{axis}_rate = {self._at('v', k, 'i')}"

    def _mates(self, block: SwarmBlock, inside: Sequence[str]) -> Iterator[str]:
        """Loop over the mates of a point that are within the cutoff."""
        cutoff = block.law.value(block.law.cutoff, "") if block.law.cutoff in block.law.columns else "cutoff"
        yield "for q in range(above[point], stops[point]):"
        yield "    mate = index(mates[q])"
        for k, axis in enumerate(self._axes):
            yield f"    d{axis} = {entry('places', k * block.listing.points, 'mate')} - {axis}_here"
        yield from (f"    {line}" for line in self._box.nearest())
        yield f"    square = {' + '.join(f'd{axis} * d{axis}' for axis in self._axes)}"
        if cutoff == "cutoff":
            yield f"    cutoff = {self._own(block, block.law.cutoff)}"
        yield f"    if square < {cutoff} * {cutoff}:"
        yield from (f"        {line}" for line in inside)

    def _pull(self, block: SwarmBlock) -> list[str]:
        """Compute the force between two points, and add it to both."""
        reads_rate = self._reads_rate(block)
        lines = [*self._length(block, reads_rate), f"pull = ({self._tension(block)}) * inverse"]
        lines += [f"f{axis} = pull * d{axis}" for axis in self._axes]
        lines += [f"{axis}_sum += f{axis}" for axis in self._axes]
        scatter = [] if reads_rate else [f"j = {self._mass(block, 'mate')}"]
        scatter += [f"{self._at('a', k, 'j')} -= f{axis} * {self._w('j')}" for k, axis in enumerate(self._axes)]
        return [*lines, *self._if_mass(block, scatter)]

    def _length(self, block: SwarmBlock, reads_rate: bool) -> list[str]:
        """Compute the distance of two points, and the rate at which it grows."""
        lines = ["r = sqrt(tiny + square)", "inverse = 1 / r"]
        if reads_rate:
            lines += [f"e{axis} = -{axis}_rate" for axis in self._axes]
            of_mate = [f"j = {self._mass(block, 'mate')}"]
            of_mate += [f"e{axis} += {self._at('v', k, 'j')}" for k, axis in enumerate(self._axes)]
            lines += [*self._if_mass(block, of_mate), *self._box.rate()]
            lines.append(f"rate = ({' + '.join(f'd{axis} * e{axis}' for axis in self._axes)}) * inverse")
        return lines

    def _if_mass(self, block: SwarmBlock, lines: list[str]) -> list[str]:
        """Do this only where the mate is a mass, if the swarm has fixed points."""
        listing = block.listing
        if listing.points == listing.masses:
            return lines
        return [f"if mate < {listing.masses}:", *(f"    {line}" for line in lines)]

    def _tension(self, block: SwarmBlock) -> str:
        law, offered = block.law, self._offered(block)
        terms = [law.call("tension", "", offered)] if "tension" in law.functions else []
        terms += [f"{law.call('density', '', offered)} * r"] if "density" in law.functions else []
        return " + ".join(terms)

    def _reads_rate(self, block: SwarmBlock) -> bool:
        return block.law.reads("rate", "tension", "density")

    def _offered(self, block: SwarmBlock) -> dict[str, str]:
        offered = {"t": "t", "r": "r", "rate": "rate"}
        return offered | {name: self._own(block, name) for name in block.listing.own}

    def _own(self, block: SwarmBlock, name: str) -> str:
        place = block.listing.own[name]
        return f"({entry('p', place, 'point')} + {entry('p', place, 'mate')})"

    def _mass(self, block: SwarmBlock, place: str) -> str:
        begin = block.listing.begin
        return f"{begin} + {place}" if begin > 0 else place if begin == 0 else f"index(indices[{place}])"

    def _at(self, array: str, k: int, i: str) -> str:
        return entry(array, self._n * k, i)

    def _w(self, i: str) -> str:
        return "w" if self._weight.is_uniform else self._weight.of(i)
