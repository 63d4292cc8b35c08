"""Write the loops over pairs of points that are near each other as lines of Python source.

In the source, point and mate are the places of two points in a list of neighbours, and i and j the indices of their
masses. The pairs are looked at in batches. A first loop collects those within the cutoff, without a branch: whether two
points touch cannot be foretold. The others do the rest for what was collected, at the place q. The compiler vectorises
that of the forces if it can.

In a large scene, threads share the points: then the forces are in a function of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar

from ..kernels.neighbours import BATCH
from ..kernels.shared_forces import ACTING, BUILDING, LISTS, SCANNING, STAGES
from .assembly import Assembly
from .box_text import BoxText
from .lines import indented, only_if
from .packing import Packing, SwarmBlock, entry

_ABOVE = "above[point], stops[point]"  # the places of the mates of a point with larger numbers
_VECTOR = 32  # pairs: a multiple of those whose forces are computed together, and a divisor of BATCH
_ALL_ABOVE = "above[begin], stops[stop - 1]"  # those of several points


B = TypeVar("B", bound=SwarmBlock)


class SwarmText(Generic[B]):
    """The swarms of one scene in the source. Each method returns lines, with their indentation."""

    _functions: tuple[str, ...] = ("tension", "density")  # of the forces

    def __init__(self, assembly: Assembly, packing: Packing, blocks: Sequence[B], first: int = 0) -> None:
        self._n, self._axes, self._weight = assembly.n, "xyz"[: assembly.dimension], packing.weight
        self._box, self._team = BoxText(packing), packing.team
        self._blocks, self._first = blocks, first  # the latter is the number of the first list among all of the scene
        self._in_part = False  # whether the lines are for a part of the points

    def forces(self) -> Iterator[str]:
        """Add the forces between near points to the accelerations of their masses."""
        for number, block in enumerate(self._blocks, self._first):
            if self._team is None:
                yield from self._refreshed(block, *self._functions)
                on_mate = only_if(self._if_mass(block), self._on_mate(block))
                yield from self._act(block, [*self._on_point(block), *on_mate])
            else:
                yield f"kept, place = memory(p), index({block.listing.place})"
                velocity = "v" if self._reads_rate(block) else "u"  # a rhs that names v is one that reads it
                given = f"t, memory(u), memory({velocity}), kept, memory(a), place"
                yield f"add_forces(share, lists, {number}, {given}, {self._team})"

    def stages(self) -> Iterator[str]:
        """Do a part of a stage that threads share: the lists of points, or the forces on them."""
        if self._team is not None:
            yield from self._stages()

    def _stages(self) -> Iterator[str]:
        self._in_part = True
        for number, block in enumerate(self._blocks, self._first):
            first = LISTS + number * STAGES
            for stage, task in ((SCANNING, "SCAN"), (BUILDING, "BUILD")) if self._team is not None else ():
                yield f"if stage == {first + stage}:"
                yield f"    lists({task}, {self._time}, u, p, index({block.listing.place}), part, parts)"
            yield from self._acting(block, first)
        self._in_part = False

    def _acting(self, block: B, first: int) -> Iterator[str]:
        """Add the forces on the points of a part."""
        yield f"if stage == {first + ACTING}:"
        yield from indented([*self._of_part(block), *self._part(block, "parts == 1")])

    def _of_part(self, block: B) -> Iterator[str]:
        """Read where the list is, and which points are those of the part."""
        yield f"kept, place = p, index({block.listing.place})"
        yield f"low, end = bounds({block.listing.masses}, part, parts)"
        yield from self._views(block, *self._functions)

    def _part(self, block: B, only_up: str) -> Iterator[str]:
        """Add the forces on the points of a part: those from points before the part, and then those from points above.

        One loop does both. In two loops, the compiler could round in two ways. `only_up` is the condition that only the
        latter are wanted.
        """
        listing = block.listing
        yield f"firsts = integers(kept, {listing.areas.first}, {listing.masses})"
        yield f"end_of_list = bounds({listing.room}, part, parts)[1]"
        on_mate = only_if("mate < end", self._on_mate(block))
        if self._is_dense(block):
            alone = [f"{self._at('a', k, 'i')} += f{axis} * {self._w('i')}" for k, axis in enumerate(self._axes)]
            act = ["if goes_up:", *indented([*self._on_point(block), *on_mate]), "else:", *indented(alone)]
            before = "(firsts[point], firsts[point - 1] if point > low else end_of_list)"
            where = f"({_ABOVE}) if goes_up else {before}"
        else:
            act = [*only_if("point >= low", self._on_point(block)), *on_mate]
            where = f"({_ALL_ABOVE}) if goes_up else (firsts[stop - 1], end_of_list)"
        yield f"for goes_up in range(int({only_up}), 2):"
        yield from indented(self._act(block, act, where))

    def _act(self, block: B, act: Sequence[str], where: str = "") -> Iterator[str]:
        """Compute the forces between near points in one loop, and add them in another one."""
        pull = [*self._length(block, self._reads_rate(block)), f"pulls[q] = ({self._tension(block)}) * inverse"]
        add = ["pull = pulls[q]", *(f"f{axis} = pull * d{axis}" for axis in self._axes), *act]
        yield "pulls = batch()"
        if not self._is_dense(block):
            yield from self._near(block, [pull, add], where)
            return
        sums = [f"{axis}_sum" for axis in self._axes]
        before = [f"{' = '.join(sums)} = 0.0"]
        after = [f"{self._at('a', k, 'i')} += {total} * {self._w('i')}" for k, total in enumerate(sums)]
        yield from self._near(block, [pull, add], where, before, after)

    def _on_point(self, block: B) -> list[str]:
        """Add a force to the point, or to its sum if points have many mates."""
        if self._is_dense(block):
            return [f"{axis}_sum += f{axis}" for axis in self._axes]
        lines = [f"{self._at('a', k, 'i')} += f{axis} * {self._w('i')}" for k, axis in enumerate(self._axes)]
        return [f"i = {self._mass(block, 'point')}", *lines]

    def _on_mate(self, block: B) -> list[str]:
        """Add a force to the mate."""
        lines = [f"{self._at('a', k, 'j')} -= f{axis} * {self._w('j')}" for k, axis in enumerate(self._axes)]
        return [f"j = {self._mass(block, 'mate')}", *lines]

    def potentials(self) -> Iterator[str]:
        """Add the potentials of near points to the total."""
        for block in self._blocks:
            if "potential" in block.law.functions:
                yield from self._refreshed(block, "potential")
                add = ["r = sqrt(tiny + square)"]
                add.append(f"total += {block.law.call('potential', '', self._offered(block))}")
                yield from self._near(block, [add])

    def power(self) -> Iterator[str]:
        """Add the power of the forces without a potential, and of the images in a box that shears."""
        for block in self._blocks:
            loses = "potential" not in block.law.functions
            if loses or self._box.shears:
                yield from self._refreshed(block, *self._functions)
                add = [*self._length(block, True), f"force = {self._tension(block)}"]
                add += ["total -= force * rate"] * loses
                add += ["fx = force * inverse * dx", *self._box.power()] if self._box.shears else []
                yield from self._near(block, [add])

    def _refreshed(self, block: B, *functions: str) -> Iterator[str]:
        """Refresh the list, and read what all pairs share."""
        yield f"kept, place = memory(p), index({block.listing.place})"
        yield f"lists(REFRESH, {self._time}, memory(u), kept, place, place, place)"
        yield from self._views(block, *functions)

    def _views(self, block: B, *functions: str) -> Iterator[str]:
        """Read where the list is, and what all pairs share."""
        listing, areas = block.listing, block.listing.areas
        yield f"places = floats(kept, {areas.x}, {len(self._axes) * listing.points})"
        for name, area in (("above", areas.above), ("stops", areas.stop)):
            yield f"{name} = integers(kept, {area}, {listing.masses})"
        for name, area in (("mates", areas.mates), ("owners", areas.owners)):
            yield f"{name} = integers(kept, {area}, {listing.room})"
        yield from (f"{name} = batch()" for name in ("squares", "some", *self._ways.values()))
        yield f"near_points = integers(some, 0, {BATCH})"
        yield f"near_mates = integers(some, {BATCH // 2}, {BATCH})"
        if listing.begin < 0:
            yield f"indices = integers(kept, {areas.number}, {listing.masses})"
        yield from block.law.constants(*functions)

    @property
    def _time(self) -> str:
        return "t" if self._box.shears else "0.0"

    @property
    def _ways(self) -> dict[str, str]:
        """What is kept of the way between two points, and the names of its batches."""
        ways = {f"d{axis}": f"{axis}_ways" for axis in self._axes}
        return ways | ({"turns": "y_turns"} if self._box.shears else {})

    def _near(
        self,
        block: B,
        loops: Sequence[Sequence[str]],
        where: str = "",
        before: Sequence[str] = (),
        after: Sequence[str] = (),
    ) -> Iterator[str]:
        """Do loops over the pairs within the cutoff, and more before and after those of a point with many mates.

        `where` are the places of the pairs in the list. The list has the pairs of a few points at a time if it has no
        room for all.
        """
        low, end = ("low", "end") if self._in_part else ("0", str(block.listing.masses))
        yield f"stop = index({low})"
        yield f"while stop < {end}:"
        yield f"    begin, stop = stop, index(lists(REACH, 0.0, kept, kept, place, stop, index({end})))"
        if not self._is_dense(block):
            yield from indented(self._batches(block, loops, where or _ALL_ABOVE))
            return
        here = [f"{axis}_here = {self._place('point', k)}" for k, axis in enumerate(self._axes)]
        inside = [f"i = {self._mass(block, 'point')}", *here, *before]
        inside += [*self._batches(block, loops, where or _ABOVE), *after]
        yield "    for point in range(begin, stop):"
        yield from (f"        {line}" for line in inside)

    def _batches(self, block: B, loops: Sequence[Sequence[str]], where: str) -> Iterator[str]:
        """Collect the pairs within the cutoff that are somewhere in the list, and do loops over them."""
        has_points = not self._is_dense(block)
        kept = {"near_mates": "mate", "squares": "square"} | {batch: value for value, batch in self._ways.items()}
        kept |= {"near_points": "point"} if has_points else {}
        yield f"low_pair, high_pair = {where}"
        yield f"for low_of_batch in range(low_pair, high_pair, {BATCH}):"
        yield "    near = index(0)"
        yield f"    for e in range(low_of_batch, min(low_of_batch + {BATCH}, high_pair)):"
        yield from (f"        {line}" for line in [*self._pair(block), *self._way(block)])
        yield from (f"        {batch}[near] = {value}" for batch, value in kept.items())
        yield f"        near += {self._is_near(block)}"
        for number, loop in enumerate(loops):
            head = "    for q in range(near):"
            if number < len(loops) - 1:
                yield from self._padded([*kept])
                head = "    for q in range(filled):"
            yield head
            yield from ("        point = index(near_points[q])" for _ in range(has_points))
            yield "        mate, square = index(near_mates[q]), squares[q]"
            yield from (f"        {value} = {batch}[q]" for value, batch in self._ways.items())
            yield from (f"        {line}" for line in loop)

    def _padded(self, batches: Sequence[str]) -> Iterator[str]:
        """Repeat the last pair until whole vectors are filled.

        Otherwise the rest would be computed by other code, which may round in another way: the bits of a force would
        depend on where its pair is in a batch.
        """
        yield f"    filled = (near + {_VECTOR - 1}) & {-_VECTOR}"
        yield "    for q in range(near, filled):"
        yield from (f"        {batch}[q] = {batch}[near - 1]" for batch in batches)

    def _pair(self, block: B) -> Iterator[str]:
        """Read a pair of the list, the smaller number first unless one loops over the points."""
        yield "mate = index(mates[e])"
        if not self._is_dense(block):
            yield "point = index(owners[e])"
            if self._in_part:
                yield "point, mate = min(point, mate), max(point, mate)"
            yield from (f"{axis}_here = {self._place('point', k)}" for k, axis in enumerate(self._axes))

    def _way(self, block: B) -> Iterator[str]:
        """Compute the way from a point to its mate, and the square of its length."""
        for k, axis in enumerate(self._axes):
            yield f"d{axis} = {self._place('mate', k)} - {axis}_here"
        yield from self._box.nearest()
        yield f"square = {' + '.join(f'd{axis} * d{axis}' for axis in self._axes)}"

    def _is_near(self, block: B) -> str:
        """The condition that two points are within the cutoff."""
        law = block.law
        cutoff = law.value(law.cutoff, "") if law.cutoff in law.columns else self._own(block, law.cutoff)
        return f"square < {cutoff} * {cutoff}"

    def _length(self, block: B, reads_rate: bool) -> list[str]:
        """Compute the distance of two points, and the rate at which it grows."""
        lines = ["r = sqrt(tiny + square)", "inverse = 1 / r"]
        if reads_rate:
            lines.append(f"i = {self._mass(block, 'point')}")
            of_mate = [f"j = {self._mass(block, 'mate')}"]
            of_mate += [f"e{axis} = {self._at('v', k, 'j')}" for k, axis in enumerate(self._axes)]
            lines.append(f"{' = '.join(f'e{axis}' for axis in self._axes)} = 0.0")
            lines += only_if(self._if_mass(block), of_mate)
            # if the point's came first, with its sign, it would be rounded in one way in vectors and in another alone
            lines += [f"e{axis} -= {self._at('v', k, 'i')}" for k, axis in enumerate(self._axes)]
            lines += self._box.rate()
            lines.append(f"rate = ({' + '.join(f'd{axis} * e{axis}' for axis in self._axes)}) * inverse")
        return lines

    def _if_mass(self, block: B) -> str:
        """The condition that the mate is a mass, if the swarm has fixed points."""
        listing = block.listing
        return "" if listing.points == listing.masses else f"mate < {listing.masses}"

    def _is_dense(self, block: B) -> bool:
        """Whether one loops over the points, and for each over its mates, because these are many."""
        return block.listing.is_dense

    def _tension(self, block: B) -> str:
        law, offered = block.law, self._offered(block)
        terms = [law.call("tension", "", offered)] if "tension" in law.functions else []
        terms += [f"{law.call('density', '', offered)} * r"] if "density" in law.functions else []
        return " + ".join(terms)

    def _reads_rate(self, block: B) -> bool:
        return block.law.reads("rate", "tension", "density")

    def _offered(self, block: B) -> dict[str, str]:
        offered = {"t": "t", "r": "r", "rate": "rate"}
        return offered | {name: self._own(block, name) for name in block.listing.own}

    def _own(self, block: B, name: str) -> str:
        place = block.listing.own[name]
        return f"({entry('p', place, 'point')} + {entry('p', place, 'mate')})"

    def _place(self, point: str, k: int) -> str:
        return entry("places", k, point if len(self._axes) == 1 else f"{len(self._axes)} * {point}")

    def _mass(self, block: B, place: str) -> str:
        begin = block.listing.begin
        return f"{begin} + {place}" if begin > 0 else place if begin == 0 else f"index(indices[{place}])"

    def _at(self, array: str, k: int, i: str) -> str:
        return entry(array, self._n * k, i)

    def _w(self, i: str) -> str:
        return "w" if self._weight.is_uniform else self._weight.of(i)
