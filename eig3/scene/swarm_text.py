"""Write the loops over pairs of points that are near each other as lines of Python source.

In the source, point and mate are the places of two points in a list of neighbours, and i and j the indices of their
masses. In a large scene, threads share the points: then the forces are in a function of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ..kernels.neighbours import BATCH
from ..kernels.shared_forces import ACTING, BUILDING, LISTS, SCANNING, STAGES
from .assembly import Assembly
from .box_text import BoxText
from .lines import indented, only_if
from .packing import Packing, SwarmBlock, entry

_ABOVE = "above[point], stops[point]"  # the places of the mates of a point with larger numbers


class SwarmText:
    """The swarms of one scene in the source. Each method returns lines, with their indentation."""

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        self._n, self._axes, self._weight = assembly.n, "xyz"[: assembly.dimension], packing.weight
        self._box, self._swarms, self._team = BoxText(packing), packing.swarms, packing.team

    def forces(self) -> Iterator[str]:
        """Add the forces between near points to the accelerations of their masses."""
        for number, block in enumerate(self._swarms):
            if self._team is not None:
                yield f"kept, place = memory(p), index({block.listing.place})"
                velocity = "v" if self._reads_rate(block) else "u"  # a rhs that names v is one that reads it
                given = f"t, memory(u), memory({velocity}), kept, memory(a), place"
                yield f"add_forces(share, lists, {number}, {given}, {self._team})"
                continue
            yield from self._refreshed(block, "tension", "density")
            act = [*self._force(block), *self._on_both(block, self._if_mass(block))]
            yield from self._masses(block, self._forces_on(block, act))

    def stages(self) -> Iterator[str]:
        """Do a part of a stage that threads share: the lists of points, or the forces on them."""
        for number, block in enumerate(self._swarms):
            first, functions = LISTS + number * STAGES, ("tension", "density")
            for stage, task in ((SCANNING, "SCAN"), (BUILDING, "BUILD")):
                yield f"if stage == {first + stage}:"
                yield f"    lists({task}, {self._time}, u, p, index({block.listing.place}), part, parts)"
            yield f"if stage == {first + ACTING}:"
            yield f"    kept, place = p, index({block.listing.place})"
            yield from indented([*self._views(block, *functions), *self._part(block)])

    def _part(self, block: SwarmBlock) -> Iterator[str]:
        """Add the forces on the points of a part: those from points before the part, and then those from points above.

        One loop does both. In two loops, the compiler could round in two ways.
        """
        listing = block.listing
        yield f"firsts = integers(kept, {listing.areas.first}, {listing.masses})"
        yield f"low, end = bounds({listing.masses}, part, parts)"
        mates = "first, last = (above[point], stops[point]) if goes_up else (firsts[point], above[point])"
        on_point = [f"{self._at('a', k, 'i')} += f{axis} * {self._w('i')}" for k, axis in enumerate(self._axes)]
        on_both = self._on_both(block, "mate < end")
        act = [*self._force(block), "if goes_up:", *indented(on_both), "else:", *indented(on_point)]
        inside = [mates, *self._forces_on(block, act, "first, last")]
        yield "for goes_up in range(int(parts == 1), 2):"
        yield from indented(self._points(inside, "low", "end"))

    def _forces_on(self, block: SwarmBlock, act: Sequence[str], mates: str = _ABOVE) -> list[str]:
        """Add the forces between a point and its mates."""
        return [
            *self._point(block, self._reads_rate(block)),
            f"{' = '.join(f'{axis}_sum' for axis in self._axes)} = 0.0",
            *self._mates(block, act, mates),
            *(f"{self._at('a', k, 'i')} += {axis}_sum * {self._w('i')}" for k, axis in enumerate(self._axes)),
        ]

    def potentials(self) -> Iterator[str]:
        """Add the potentials of near points to the total."""
        for block in self._swarms:
            if "potential" in block.law.functions:
                yield from self._refreshed(block, "potential")
                offered = self._offered(block)
                inside = ["r = sqrt(tiny + square)", f"total += {block.law.call('potential', '', offered)}"]
                yield from self._masses(block, [*self._point(block, False), *self._mates(block, inside)])

    def power(self) -> Iterator[str]:
        """Add the power of the forces without a potential, and of the images in a box that shears."""
        for block in self._swarms:
            loses = "potential" not in block.law.functions
            if loses or self._box.shears:
                yield from self._refreshed(block, "tension", "density")
                inside = [*self._length(block, True), f"force = {self._tension(block)}"]
                inside += ["total -= force * rate"] * loses
                inside += ["fx = force * inverse * dx", *self._box.power()] if self._box.shears else []
                yield from self._masses(block, [*self._point(block, True), *self._mates(block, inside)])

    def _refreshed(self, block: SwarmBlock, *functions: str) -> Iterator[str]:
        """Refresh the list, and read what all pairs share."""
        yield f"kept, place = memory(p), index({block.listing.place})"
        yield f"lists(REFRESH, {self._time}, memory(u), kept, place, place, place)"
        yield from self._views(block, *functions)

    def _views(self, block: SwarmBlock, *functions: str) -> Iterator[str]:
        """Read where the list is, and what all pairs share."""
        listing, areas = block.listing, block.listing.areas
        yield f"places = floats(kept, {areas.x}, {len(self._axes) * listing.points})"
        yield f"above = integers(kept, {areas.above}, {listing.masses})"
        yield f"stops = integers(kept, {areas.stop}, {listing.masses})"
        yield f"mates = integers(kept, {areas.mates}, {listing.room})"
        if listing.is_dense:
            for name in (*(f"{axis}_ways" for axis in self._axes), "squares", "some"):
                yield f"{name} = batch()"
            yield f"which = integers(some, 0, {BATCH})"
        if listing.begin < 0:
            yield f"indices = integers(kept, {areas.number}, {listing.masses})"
        yield from block.law.constants(*functions)

    @property
    def _time(self) -> str:
        return "t" if self._box.shears else "0.0"

    def _masses(self, block: SwarmBlock, inside: Iterable[str]) -> Iterator[str]:
        """Loop over the masses of a list."""
        return self._points(inside, "0", str(block.listing.masses))

    def _points(self, inside: Iterable[str], low: str, end: str) -> Iterator[str]:
        """Loop over some masses of a list, which has the pairs of a few of them at a time if it has no room for all."""
        yield f"stop = index({low})"
        yield f"while stop < {end}:"
        yield f"    begin, stop = stop, index(lists(REACH, 0.0, kept, kept, place, stop, index({end})))"
        yield "    for point in range(begin, stop):"
        yield from (f"        {line}" for line in inside)

    def _point(self, block: SwarmBlock, reads_rate: bool) -> Iterator[str]:
        """Read the position of a point, and its velocity."""
        yield f"i = {self._mass(block, 'point')}"
        for k, axis in enumerate(self._axes):
            yield f"{axis}_here = {entry('places', k * block.listing.points, 'point')}"
            if reads_rate:
                yield f"{axis}_rate = {self._at('v', k, 'i')}"

    def _mates(self, block: SwarmBlock, inside: Sequence[str], mates: str = _ABOVE) -> Iterator[str]:
        """Loop over the mates of a point that are within the cutoff."""
        if block.listing.is_dense:
            yield from self._batches(block, inside, mates)
            return
        yield f"for q in range({mates}):"
        yield "    mate = index(mates[q])"
        yield from indented(self._way(block))
        yield f"    if {self._is_near(block, 'square')}:"
        yield from (f"        {line}" for line in inside)

    def _batches(self, block: SwarmBlock, inside: Sequence[str], mates: str) -> Iterator[str]:
        """Do so for many mates, in three loops: the compiler vectorises the first, and the second has no branch."""
        ways = [f"{axis}_ways" for axis in self._axes]
        yield f"low_mate, high_mate = {mates}"
        yield f"for low_of_batch in range(low_mate, high_mate, {BATCH}):"
        yield f"    size, near = min({BATCH}, high_mate - low_of_batch), index(0)"
        yield "    for k in range(size):"
        yield "        mate = index(mates[low_of_batch + k])"
        yield from (f"        {line}" for line in self._way(block))
        yield f"        {', '.join(f'{way}[k]' for way in ways)}, squares[k] = {self._ways}, square"
        yield "    for k in range(size):"
        yield "        mate = index(mates[low_of_batch + k])"
        yield "        which[near] = k"
        yield f"        near += {self._is_near(block, 'squares[k]')}"
        yield "    for q in range(near):"
        yield "        k = index(which[q])"
        yield "        mate = index(mates[low_of_batch + k])"
        yield f"        {self._ways}, square = {', '.join(f'{way}[k]' for way in ways)}, squares[k]"
        yield from (f"        {line}" for line in inside)

    def _way(self, block: SwarmBlock) -> Iterator[str]:
        """Compute the way from a point to its mate, and the square of its length."""
        for k, axis in enumerate(self._axes):
            yield f"d{axis} = {entry('places', k * block.listing.points, 'mate')} - {axis}_here"
        yield from self._box.nearest()
        yield f"square = {' + '.join(f'd{axis} * d{axis}' for axis in self._axes)}"

    @property
    def _ways(self) -> str:
        return ", ".join(f"d{axis}" for axis in self._axes)

    def _is_near(self, block: SwarmBlock, square: str) -> str:
        """The condition that two points are within the cutoff."""
        law = block.law
        cutoff = law.value(law.cutoff, "") if law.cutoff in law.columns else self._own(block, law.cutoff)
        return f"{square} < {cutoff} * {cutoff}"

    def _force(self, block: SwarmBlock) -> list[str]:
        """Compute the force between two points."""
        reads_rate = self._reads_rate(block)
        lines = [*self._length(block, reads_rate), f"pull = ({self._tension(block)}) * inverse"]
        return [*lines, *(f"f{axis} = pull * d{axis}" for axis in self._axes)]

    def _on_both(self, block: SwarmBlock, condition: str) -> list[str]:
        """Add the force between two points to both, or to the point only if its mate does not meet the condition."""
        scatter = [f"j = {self._mass(block, 'mate')}"]
        scatter += [f"{self._at('a', k, 'j')} -= f{axis} * {self._w('j')}" for k, axis in enumerate(self._axes)]
        return [*(f"{axis}_sum += f{axis}" for axis in self._axes), *only_if(condition, scatter)]

    def _length(self, block: SwarmBlock, reads_rate: bool) -> list[str]:
        """Compute the distance of two points, and the rate at which it grows."""
        lines = ["r = sqrt(tiny + square)", "inverse = 1 / r"]
        if reads_rate:
            lines += [f"e{axis} = -{axis}_rate" for axis in self._axes]
            of_mate = [f"j = {self._mass(block, 'mate')}"]
            of_mate += [f"e{axis} += {self._at('v', k, 'j')}" for k, axis in enumerate(self._axes)]
            lines += [*only_if(self._if_mass(block), of_mate), *self._box.rate()]
            lines.append(f"rate = ({' + '.join(f'd{axis} * e{axis}' for axis in self._axes)}) * inverse")
        return lines

    def _if_mass(self, block: SwarmBlock) -> str:
        """The condition that the mate is a mass, if the swarm has fixed points."""
        listing = block.listing
        return "" if listing.points == listing.masses else f"mate < {listing.masses}"

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
