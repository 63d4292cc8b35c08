"""Lists of the points that are near each other, kept in the memory that a run has at the end of its parameters.

A list has the pairs within their cutoff and a skin. It is valid until a point has moved by half of the skin; then it is
built anew from cells. Pairs beyond their cutoff do not act, and those that act are in the order of their points. So the
forces have the same bits whenever the list was built, and a run may continue from any copy of it.

A list that does not fit into its memory has no skin, and is built piece by piece in each evaluation: as many points at
a time as there is room for.

Threads share the points: each has a part of them, which follow each other. A pair of points of two parts is in the
list of both. Each part adds the forces on its own points only, in the order in which one thread adds them, so that the
forces have the same bits for any number of threads.

The method is by L. Verlet, Physical Review 159 (1967), with the cells of R. W. Hockney and J. W. Eastwood,
Computer Simulation Using Particles (1981), in a hash table, as by M. Teschner et al., Optimized Spatial Hashing
for Collision Detection of Deformable Objects (2003): the time does not depend on how far apart the points are.

All numbers are in p, from the index `place` on: first the numbers below, then the areas that `Areas` names. The number
of dimensions d is a constant in each of the functions at the end, so that the compiler unrolls the loops over it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numba.extending import intrinsic
from numba.types import Array, float64, int32, int64

from .compile.jit import element, of_library, outlined
from .compile.numba_internals import array_over, parts_of
from .protocol import array_on_stack, vector_type

#: The numbers of a list: of its points, of the masses among them (which come first), and of all masses of the scene;
#: the skin; 1 if only pairs of different groups count; the largest cutoff, and where in p each point has its cutoff, or
#: 0; the number of pairs for which there is room; and the number of buckets, a power of two.
POINTS, MASSES, STRIDE, SKIN, HAS_GROUPS, CUTOFF, OWN_CUTOFFS, ROOM, BUCKETS = range(9)
#: The mark of a list; the sides of the periodic box, 0 for none, and the rate at which it shears; the time when the
#: list was built, and by how much the images above were moved then; the number of the first points whose pairs are in
#: the list, which is valid if these are all masses; the skin that it has; the number of parts that it has, and of those
#: that were wanted.
MARK, BOX, SHEAR, BUILT_AT, TILT, LISTED, PRESENT_SKIN, PARTS, WANTED = 9, 10, *range(13, 20)
#: For each part, how far a point has moved, and the first point whose pairs are not in the list; the grid of cells; and
#: room for some positions.
MOST_PARTS = 64
_MOVED, _REACHED = WANTED + 1, WANTED + 1 + MOST_PARTS
_GRID = _REACHED + MOST_PARTS
_SOME, _SAMPLES = _GRID + 12, 64  # points, from which the region of the cells is chosen
HEAD = _SOME + _SAMPLES
#: The parts of the grid: numbers of cells, 0 for an axis without end; where the cells begin; cells in a metre; and the
#: steps between the buckets of neighbouring cells.
_NUMBERS, _LOWS, _SCALES, _STEPS = _GRID, _GRID + 3, _GRID + 6, _GRID + 9

#: The areas, in the order of `Areas`.
#: They are no literals, for each of which Numba would compile `area` once more; and so are the axes, for `cell`.
X, BUILT, SORTED, FIRST, ABOVE, STOP, MATES, OWNERS, NUMBER, GROUP, APART, APART_MATES, ORDER, BUCKET, START = map(
    np.int64, range(15)
)
_X, _Y, _Z = map(np.int64, range(3))

IS_LIST = 0.1  # the mark, which a conversion to single precision changes as it does the integers of a list
_PART = 12  # a part of 1/12 of the points may lie beyond the region at each end, which is then
_BEYOND = 1.25  # times as long
_CELLS = 2.0**20  # along the region at most, and along a side of the box
_FAR = 2.0**30  # cells from the middle of the region on which points share a cell
_ROUND_OFF = 1e-6  # a part of a cell that is larger than the round-off so far from the middle
_LARGEST = np.finfo(np.float64).max
_ULPS = 1e-12  # a part of a cutoff that is larger than the round-off of a distance
_ROW, _LAYER = 2654435761, 2246822519  # steps between buckets, odd and with bits that follow no pattern
BATCH = 192  # points, or pairs, that are looked at together


class Areas(NamedTuple):
    """The places in p of the areas of a list.

    Attributes
    ----------
    x, built : int
        The positions of the points, now and when the list was built: d floats for each point.
    ordered : int
        The latter in the order of their buckets: d rows of floats.
    first, above, stop : int
        Where in the list the mates of each mass begin that are in other parts and have a smaller number; and where
        those with a larger number begin and end. These and the following are 32-bit integers.
    mates, owners : int
        The list: pairs of a mate and the mass whose mate it is. In the room of a part, the mates with larger numbers
        follow each other from the begin on, and those with smaller numbers are at the end.
    number : int
        The number of each mass among all masses of the scene.
    group : int
        The group of each point.
    apart, apart_mates : int
        The pairs that are left out, in the same form as the list.
    order, bucket, start : int
        The points by their buckets, the bucket of each point or -1, and where each bucket begins.
    """

    x: int
    built: int
    ordered: int
    first: int
    above: int
    stop: int
    mates: int
    owners: int
    number: int
    group: int
    apart: int
    apart_mates: int
    order: int
    bucket: int
    start: int

    @classmethod
    def of(cls, place: int, points: int, room: int, buckets: int, n_apart: int, dimension: int) -> tuple[Areas, int]:
        """Return the areas of a list at a place of p, and where they end."""
        floats = [dimension * points] * 3
        integers = [*[points] * 3, room, room, points, points, points + 1, n_apart, points, points, buckets + 1]
        begins = np.cumsum([place + HEAD + len(cls._fields), *floats, *((size + 1) // 2 for size in integers)])
        return cls(*begins[:-1].tolist()), int(begins[-1])


_integers, _floats = Array(int32, 1, "C"), vector_type


@intrinsic
def integers(typingctx, p, begin, count):  # type: ignore[no-untyped-def]
    """``integers(p, begin, count)`` is an array of 32-bit integers in the memory of p from the index `begin` on."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = builder.gep(parts_of(context, builder, signature.args[0], args[0]).data, [args[1]])
        data = builder.bitcast(data, context.get_data_type(int32).as_pointer())
        return array_over(context, builder, _integers, data, args[2])

    return _integers(p, int64, int64), codegen


def as_floats(values: np.ndarray) -> np.ndarray:
    """Return the part of p that has these values as its 32-bit `integers`, two in each float."""
    part = np.zeros((len(values) + 1) // 2)
    part.view(np.int32)[: len(values)] = values
    return part


@intrinsic
def floats(typingctx, p, begin, count):  # type: ignore[no-untyped-def]
    """``floats(p, begin, count)`` is an array of floats in the memory of p, which may be written."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = builder.gep(parts_of(context, builder, signature.args[0], args[0]).data, [args[1]])
        return array_over(context, builder, _floats, data, args[2])

    return _floats(p, int64, int64), codegen


#: ``batch()`` is an array of BATCH floats on the stack.
batch = array_on_stack(BATCH)


@element
def area(p, place, k):
    """Return the place of an area."""
    return int64(p[place + HEAD + k])


@intrinsic
def memory(typingctx, array):  # type: ignore[no-untyped-def]
    """``memory(array)`` is the same array, which may be written: the functions here are compiled for one type only.

    An array of one of several lanes is refused, because its values are not neighbours: members with lists run alone.
    """
    if array.layout != "C":
        raise numba.TypingError("lists of neighbours and constraints need memory of their own for each member")

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        parts = parts_of(context, builder, signature.args[0], args[0])
        return array_over(context, builder, _floats, parts.data, parts.shape[0])

    return _floats(array), codegen


@element
def refresh(t, u, p, place, d):
    """Copy the positions of the masses, and build the list anew if it may miss a pair."""
    parts = int64(p[place + WANTED])
    for part in range(parts):
        scan(t, u, p, place, part, parts, d)
    if is_valid(t, p, place, parts):
        return
    begin(t, p, place, parts, d)
    while True:
        parts = int64(p[place + PARTS])
        for part in range(parts):
            build(p, place, part, parts, d)
        if is_built(p, place, d):
            return


@element
def bounds(count, part, parts):
    """Return the first of the values of a part of `count` values, and the end of the part."""
    return count * part // parts, count * (part + 1) // parts


@element
def scan(t, u, p, place, part, parts, d):
    """Copy the positions of the masses of a part, and note how far a point has moved since the list was built.

    The first part has the fixed points too: the scene writes where they are if a motion moves them. In a box that
    shears, what a point moves with the flow since then counts for the way between two points only.
    """
    if p[place + MARK] != IS_LIST:
        raise ValueError(
            "params must be the parameters of the scene in double precision: its neighbor lists are among them."
        )
    count, stride = int64(p[place + POINTS]), int64(p[place + STRIDE])
    x, built = floats(p, area(p, place, X), d * count), floats(p, area(p, place, BUILT), d * count)
    index = integers(p, area(p, place, NUMBER), count)
    worst, strain = 0.0, p[place + SHEAR] * (t - p[place + BUILT_AT])
    masses = int64(p[place + MASSES])
    start, end = bounds(masses, part, parts)
    for i in range(start, end):
        at, square = int64(index[i]), 0.0
        for k in range(d):
            now = u[k * stride + at]
            way = now - built[d * i + k]
            if k == 0 and d > 1:
                way -= strain * built[d * i + 1]
            x[d * i + k] = now
            square += way * way
        worst = max(worst, square if square == square else math.inf)
    for i in range(masses, count if part == 0 else masses):
        square = 0.0
        for k in range(d):
            square += (x[d * i + k] - built[d * i + k]) ** 2
        worst = max(worst, square if square == square else math.inf)
    floats(p, place + _MOVED, MOST_PARTS)[part] = worst


@element
def is_valid(t, p, place, parts):
    """Return whether the list misses no pair, and has these parts."""
    worst, strain = 0.0, p[place + SHEAR] * (t - p[place + BUILT_AT])
    for part in range(parts):
        worst = max(worst, p[place + _MOVED + part])
    skin = p[place + PRESENT_SKIN]
    limit = (skin - abs(strain) * (p[place + CUTOFF] + skin)) / 2
    is_whole = p[place + LISTED] == p[place + MASSES] and p[place + WANTED] == parts
    return is_whole and limit >= 0 and worst <= limit * limit


@element
def begin(t, p, place, parts, d):
    """Prepare a new list, with the skin that is tried first. Its pairs are then found part by part."""
    count, head = int64(p[place + POINTS]), floats(p, place, HEAD)
    x, built = floats(p, area(p, place, X), d * count), floats(p, area(p, place, BUILT), d * count)
    head[BUILT_AT] = t
    head[TILT] = nearest(head[SHEAR] * head[BOX + 1] * t, head[BOX])
    for j in range(d * count):
        built[j] = x[j]
    head[WANTED] = head[PARTS] = parts
    head[PRESENT_SKIN] = first_skin(p, place)
    sort_by_cells(x, p, place, head[CUTOFF] + head[PRESENT_SKIN], d)


@element
def first_skin(p, place):
    """Return the skin to be tried first: the skin of the list, unless it had no room for the last pairs with a skin."""
    masses = int64(p[place + MASSES])
    if p[place + PRESENT_SKIN] > 0:
        return p[place + SKIN]
    if p[place + LISTED] < masses:
        return 0.0
    pairs = integers(p, area(p, place, STOP), masses)[masses - 1]
    return p[place + SKIN] / (1 if 2 * pairs <= p[place + ROOM] else 4)


@element
def is_built(p, place, d):
    """Return whether the list has all pairs for which there is room; if there may be more room, prepare to try again.

    One part alone has more room than several parts, one of which is full, and a smaller skin has fewer pairs.
    """
    parts, is_whole, head = int64(p[place + PARTS]), True, floats(p, place, HEAD)
    for part in range(parts):
        is_whole &= head[_REACHED + part] == bounds(int64(head[MASSES]), part, parts)[1]
    head[LISTED] = head[MASSES] if is_whole else head[_REACHED] if parts == 1 else 0.0
    if is_whole or (parts == 1 and head[PRESENT_SKIN] == 0):
        return True
    if parts > 1:
        head[PARTS] = 1.0
    else:
        skin = head[PRESENT_SKIN] / 2 if head[PRESENT_SKIN] > head[SKIN] / 4 else 0.0
        head[PRESENT_SKIN] = skin
        count = int64(head[POINTS])
        sort_by_cells(floats(p, area(p, place, X), d * count), p, place, head[CUTOFF] + skin, d)
    return False


@element
def listed(p, place, start, end, d):
    """Return up to which point, and up to `end`, the pairs from the point `start` on follow each other in the list.

    If there is no room for all pairs, the list has one part. If `start` is not where it begins, the pairs of the points
    before have been looked at, and the list continues with the points that follow.
    """
    masses, parts = int64(p[place + MASSES]), int64(p[place + PARTS])
    if start == 0 or p[place + LISTED] == masses:
        for part in range(parts):
            stop = bounds(masses, part, parts)[1]
            if stop > start:  # the other parts have room of their own
                return min(end, stop, int64(p[place + LISTED]))
    return pairs_of(p, place, start, end, np.int64(0), np.int64(0), int64(p[place + ROOM]), d)


@element
def build(p, place, part, parts, d):
    """Write the pairs of the points of a part to the list."""
    start, end = bounds(int64(p[place + MASSES]), part, parts)
    low, high = bounds(int64(p[place + ROOM]), part, parts)
    floats(p, place + _REACHED, MOST_PARTS)[part] = pairs_of(p, place, start, end, start, low, high, d)


@outlined
def pairs_of(p, place, start, end, lowest, low, high, d):
    """Write the pairs of the points from `start` to `end` to the list, within their cutoffs and the skin.

    These are pairs with points of larger numbers, from the place `low` of the list on, and with points of numbers below
    `lowest`, up to the place `high`. Return the number of the first point for whose pairs there is no room.
    """
    count, masses, room = int64(p[place + POINTS]), int64(p[place + MASSES]), int64(p[place + ROOM])
    x, skin = floats(p, area(p, place, X), d * count), p[place + PRESENT_SKIN]
    first, above = integers(p, area(p, place, FIRST), masses), integers(p, area(p, place, ABOVE), masses)
    stop, mates = integers(p, area(p, place, STOP), masses), integers(p, area(p, place, MATES), room)
    owners = integers(p, area(p, place, OWNERS), room)
    group, has_groups = integers(p, area(p, place, GROUP), count), p[place + HAS_GROUPS] == 1
    apart = integers(p, area(p, place, APART), count + 1)
    apart_mates = integers(p, area(p, place, APART_MATES), int64(apart[count]))
    order, bucket = integers(p, area(p, place, ORDER), count), integers(p, area(p, place, BUCKET), count)
    ordered = area(p, place, SORTED)
    above_x, above_y = ordered + count, ordered + 2 * count
    starts, mask = integers(p, area(p, place, START), int64(p[place + BUCKETS]) + 1), int64(p[place + BUCKETS]) - 1
    own, widest = int64(p[place + OWN_CUTOFFS]), p[place + CUTOFF]
    # what is read here need not be read again in the loops, in which the list is written
    side_x, side_y, side_z, tilt = p[place + BOX], p[place + BOX + 1], p[place + BOX + 2], p[place + TILT]
    inverse_x, inverse_y, inverse_z = inverse(side_x), inverse(side_y), inverse(side_z)
    nx, ny, nz = int64(p[place + _NUMBERS]), int64(p[place + _NUMBERS + 1]), int64(p[place + _NUMBERS + 2])
    low_x, high_x = around(nx)
    low_y, high_y = around(ny)
    low_z, high_z = around(nz)
    across, over = floats(p, place + _STEPS, 3)[1:]
    squares, some = batch(), batch()
    k, which, furthest = low, integers(some, 0, BATCH), ((1 + _ULPS) * (skin + widest)) ** 2
    for i in range(start, end):
        above[i] = stop[i] = begin_of_mates = k
        first[i] = high
        if bucket[i] < 0:
            continue
        cx = cell(x, p, place, _X, i, d)
        cy = cell(x, p, place, _Y, i, d)
        cz = cell(x, p, place, _Z, i, d)
        x_here, y_here, z_here = x[d * i], x[d * i + 1] if d > 1 else 0.0, x[d * i + 2] if d > 2 else 0.0
        for oz in range(low_z, high_z):
            for oy in range(low_y, high_y):
                row = int64(across) * within(cy + oy, ny) + int64(over) * within(cz + oz, nz)
                c = (row + cx) & mask
                in_row = 0 < c < mask and (nx == 0 or 0 < cx < nx - 1)  # three buckets follow each other
                for ox in range(0 if in_row else low_x, 1 if in_row else high_x):
                    c = c if in_row else (row + within(cx + ox, nx)) & mask
                    last = starts[c + 1 + in_row]
                    for begin in range(starts[c - in_row], last, BATCH):
                        size, near = min(BATCH, last - begin), 0
                        xs = floats(p, ordered + begin, size)  # with an index that is a sum, LLVM does not vectorise
                        ys, zs = floats(p, above_x + begin, size), floats(p, above_y + begin, size)
                        for e in range(size):
                            square, turns = 0.0, 0.0
                            if d > 1:
                                way = ys[e] - y_here
                                turns = np.rint(way * inverse_y)
                                square = (way - side_y * turns) ** 2
                            way = xs[e] - x_here - tilt * turns
                            square += (way - side_x * np.rint(way * inverse_x)) ** 2
                            if d > 2:
                                way = zs[e] - z_here
                                square += (way - side_z * np.rint(way * inverse_z)) ** 2
                            squares[e] = square
                        numbers = integers(order, begin, size)
                        for e in range(size):
                            which[near], j = e, numbers[e]
                            near += (squares[e] < furthest) & ((j < lowest) | (j > i))
                        for q in range(near):
                            j = int64(numbers[which[q]])
                            if has_groups and group[i] == group[j]:
                                continue
                            if own > 0 and squares[which[q]] >= ((1 + _ULPS) * (skin + p[own + i] + p[own + j])) ** 2:
                                continue
                            if is_apart(apart, apart_mates, min(i, j), max(i, j)):
                                continue
                            if k == high:
                                k = sort(mates, begin_of_mates, k)
                                if k == high:
                                    return i
                            mates[k] = j
                            k += 1
        k = sort(mates, begin_of_mates, k)
        below = 0
        while begin_of_mates + below < k and mates[begin_of_mates + below] < i:
            below += 1
        high -= below
        if high < k:
            return i
        for q in range(below):
            mates[high + q], owners[high + q] = mates[begin_of_mates + q], i
        k -= below
        for q in range(begin_of_mates, k):
            mates[q], owners[q] = mates[q + below], i
        first[i], stop[i] = high, k
    return end


@element
def nearest(way, side):
    """Return the way to the nearest image along an axis, which may be periodic."""
    return way - side * np.rint(way / side) if side > 0 else way


@element
def inverse(side):
    """Return the inverse of a side of the box, or 0 for none, for which the nearest image is the point itself."""
    return 1 / side if side > 0 else 0.0


@element
def is_apart(apart, mates, i, j):
    """Return whether a pair is left out."""
    found = False
    for q in range(apart[i], apart[i + 1]):
        found |= mates[q] == j
    return found


@element
def around(count):
    """Return the range of steps from a cell to those beside it along an axis with 1 cell, or with many."""
    return (0, 1) if count == 1 else (-1, 2)


@element
def within(c, count):
    """Return the number of a cell along an axis, which may be periodic."""
    if count == 0:
        return c
    return c + count if c < 0 else (c - count if c >= count else c)


@element
def sort(values, begin, end):
    """Sort a few neighbouring values, and leave out those that occur twice; return their end.

    Two cells beside each other may share a bucket, whose points are then found twice.
    """
    stop = begin
    for q in range(begin, end):
        value, k = values[q], stop
        while k > begin and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        if k == begin or values[k - 1] < value:
            values[k] = value
            stop += 1
        else:  # move those above back
            for above in range(k, stop):
                values[above] = values[above + 1]
    return stop


@outlined
def sort_by_cells(x, p, place, size, d):
    """Sort the points by the buckets of their cells, which are at least as long as `size`."""
    count, buckets = int64(p[place + POINTS]), int64(p[place + BUCKETS])
    order, bucket = integers(p, area(p, place, ORDER), count), integers(p, area(p, place, BUCKET), count)
    start = integers(p, area(p, place, START), buckets + 1)
    ordered = floats(p, area(p, place, SORTED), d * count)
    divide(x, p, place, size, d)
    across, over = floats(p, place + _STEPS, 3)[1:]
    for c in range(buckets + 1):
        start[c] = 0
    for i in range(count):
        bucket[i] = -1
        sum_of_all = 0.0
        for k in range(d):
            sum_of_all += abs(x[d * i + k])
        if sum_of_all < math.inf:  # a point without a place is near to none
            row = int64(across) * cell(x, p, place, _Y, i, d) + int64(over) * cell(x, p, place, _Z, i, d)
            c = (row + cell(x, p, place, _X, i, d)) & (buckets - 1)
            bucket[i] = c
            start[c] += 1
    end = 0
    for c in range(buckets + 1):
        end += start[c]
        start[c] = end
    for i in range(count - 1, -1, -1):
        c = int64(bucket[i])
        if c >= 0:
            start[c] -= 1
            order[start[c]] = i
            for k in range(d):
                ordered[k * count + start[c]] = x[d * i + k]


@element
def divide(x, p, place, size, d):
    """Choose the cells. They fill the periodic box, or are without end.

    If there is a bucket for each cell of the region, neighbouring cells have neighbouring buckets.
    """
    head = floats(p, place, HEAD)
    for k in range(3):
        head[_NUMBERS + k] = 1.0
    along = 1.0
    size *= 1 + _ROUND_OFF
    for k in range(d):
        side = head[BOX + k]
        if side > 0:
            slant = p[place + TILT] / head[BOX + 1] if k == 0 and p[place + TILT] != 0 else 0.0
            number = math.floor(min(side / (size * math.sqrt(1 + slant * slant)), _CELLS))
            number = number if number >= 3 else 1.0
            head[_NUMBERS + k], head[_LOWS + k], head[_SCALES + k] = number, 0.0, number / side
            extent = number
        else:
            low, length = region(x, k, d, floats(p, place + _SOME, _SAMPLES))
            scale = 1 / max(size, length / _CELLS)
            head[_NUMBERS + k], head[_LOWS + k], head[_SCALES + k] = 0.0, low, scale
            extent = math.floor(_BEYOND * length * scale) + 3
        head[_STEPS + k], along = along, along * extent
    if along > head[BUCKETS]:
        head[_STEPS + 1], head[_STEPS + 2] = _ROW, _LAYER


@element
def cell(x, p, place, k, i, d):
    """Return the number of the cell of a point along an axis."""
    if k >= d:
        return 0
    tilt = p[place + TILT]
    along = x[d * i + k] - p[place + _LOWS + k]
    if k == 0 and tilt != 0:  # then there are more dimensions, and a side along y
        along -= tilt / p[place + BOX + 1] * x[d * i + 1]
    along *= p[place + _SCALES + k]
    number = p[place + _NUMBERS + k]
    if number > 0:
        return int64(min(along - number * np.floor(along / number), number - 1))
    return math.floor(min(max(along, -_FAR), _FAR))


@element
def region(x, k, d, some):
    """Return the middle and the length of a range along an axis with most of the points, of which some are copied."""
    count, points = int64(0), len(x) // d
    for e in range(len(some)):
        value = x[d * (e * points // len(some)) + k]
        if abs(value) < math.inf:
            some[count] = value
            count += 1
    count = sort(some, int64(0), count)  # `sort` has one code for numbers, and one more for each literal
    if count == 0:
        return 0.0, 0.0
    return some[count // 2], min(some[count - 1 - count // _PART] - some[count // _PART], _LARGEST)


#: The tasks of `lists`. They are no literals, for each of which Numba would compile it once more.
REFRESH, SCAN, CHECK, BEGIN, BUILD, FINISH, REACH = map(np.int64, range(7))


@element
def lists(task, t, u, p, place, part, parts, d):
    """Do one task: `refresh` a list, or, where threads share it, `scan`, check, `begin`, `build` and finish it.

    The task REACH returns the result of `listed`, for a piece from the point `part` to the point `parts`. The tasks
    REFRESH and FINISH ignore both.
    """
    if task == REFRESH:
        refresh(t, u, p, place, d)
    elif task == SCAN:
        scan(t, u, p, place, part, parts, d)
    elif task == CHECK:
        return int64(is_valid(t, p, place, parts))
    elif task == BEGIN:
        begin(t, p, place, parts, d)
    elif task == BUILD:
        build(p, place, part, parts, d)
    elif task == FINISH:
        return int64(is_built(p, place, d))
    else:
        return listed(p, place, part, parts, d)
    return 0


_LISTS = int64(int64, float64, _floats, _floats, int64, int64, int64)


@of_library(_LISTS)
def lists_1d(task, t, u, p, place, part, parts):
    """Call `lists` in one dimension."""
    return lists(task, t, u, p, place, part, parts, 1)


@of_library(_LISTS)
def lists_2d(task, t, u, p, place, part, parts):
    """Call `lists` in two dimensions."""
    return lists(task, t, u, p, place, part, parts, 2)


@of_library(_LISTS)
def lists_3d(task, t, u, p, place, part, parts):
    """Call `lists` in three dimensions."""
    return lists(task, t, u, p, place, part, parts, 3)


#: `lists`, by the number of dimensions.
LISTS = {1: lists_1d, 2: lists_2d, 3: lists_3d}
