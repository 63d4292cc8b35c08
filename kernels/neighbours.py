"""Lists of the points that are near each other, kept in the memory that a run has at the end of its parameters.

A list has the pairs within their cutoff and a skin. It is valid until a point has moved by half of the skin; then it is
built anew from cells. Pairs beyond their cutoff do not act, and those that act are in the order of their points. So the
forces have the same bits whenever the list was built: it is a memo, and a run may go on from any copy of it.

A list that does not fit into its memory has no skin, and is built in parts in each evaluation: as many points at a time
as there is room for.

The method is that of L. Verlet, Physical Review 159 (1967), with the cells of R. W. Hockney and J. W. Eastwood,
Computer Simulation Using Particles (1981), in a hash table, as that of M. Teschner et al., Optimized Spatial Hashing
for Collision Detection of Deformable Objects (2003): the time does not depend on how far apart the points are.

All numbers are in p, from the index `place` on: first the numbers below, then the areas that `Areas` names. The number
of dimensions d is a constant in each of the functions at the end, so that the compiler unrolls the loops over it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import intrinsic
from numba.types import Array, int32, int64, intp

from .compile.cache import keep_on_disk
from .compile.jit import KERNEL_OPTIONS, element
from .compile.numba_internals import array_over, parts_of
from .protocol import vector_type

#: The numbers of a list: of its points, of the masses among them (which come first), and of all masses of the scene;
#: the skin; 1 if only pairs of different groups count; the largest cutoff, and where in p each point has its cutoff, or
#: 0; the number of pairs for which there is room; and the number of buckets, a power of two.
POINTS, MASSES, STRIDE, SKIN, HAS_GROUPS, CUTOFF, OWN_CUTOFFS, ROOM, BUCKETS = range(9)
#: The sides of the periodic box, 0 for none, and the rate at which it shears; the time when the list was built, and by
#: how much the images above were moved then; the number of the first points whose pairs are in the list, which is valid
#: if these are all masses; the skin that it has; room for the grid of cells; the mark of a list; and room for some
#: positions.
BOX, SHEAR, BUILT_AT, TILT, LISTED, PRESENT_SKIN, GRID, MARK, SOME = 9, 12, 13, 14, 15, 16, 17, 26, 27
IS_LIST = 0.1  # the mark, which a conversion to single precision changes as it does the integers of a list
_SAMPLES = 64  # points, from which the region of the cells is chosen
HEAD = SOME + _SAMPLES
#: The parts of the grid: numbers of cells, 0 for an axis without end; where the cells begin; and cells in a metre.
_NUMBERS, _LOWS, _SCALES = GRID, GRID + 3, GRID + 6

#: The areas, in the order of `Areas`.
X, BUILT, FIRST, MATES, NUMBER, GROUP, APART, APART_MATES, ORDER, BUCKET, START = range(11)

_PART = 12  # a part of 1/12 of the points may lie beyond the region at each end
_CELLS = 2.0**20  # along the region at most, and along a side of the box
_FAR = 2.0**30  # cells from the middle of the region on which points share a cell
_ROUND_OFF = 1e-6  # a part of a cell that is larger than the round-off so far from the middle
_LARGEST = np.finfo(np.float64).max
_ULPS = 1e-12  # a part of a cutoff that is larger than the round-off of a distance
_ROW, _LAYER = 2654435761, 2246822519  # odd, with bits that follow no pattern: the steps between buckets of rows


class Areas(NamedTuple):
    """The places in p of the areas of a list.

    Attributes
    ----------
    x, built : int
        The positions of the points, now and when the list was built: d rows of floats.
    first, mates : int
        Where the mates of each point begin, and all mates; these and the following are 32-bit integers.
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
    first: int
    mates: int
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
        floats = [dimension * points] * 2
        integers = [points + 1, room, points, points, points + 1, n_apart, points, points, buckets + 1]
        begins = np.cumsum([place + HEAD + len(cls._fields), *floats, *((size + 1) // 2 for size in integers)])
        return cls(*begins[:-1].tolist()), int(begins[-1])


_integers, _floats = Array(int32, 1, "C"), vector_type


@intrinsic
def integers(typingctx, p, begin, count):  # type: ignore[no-untyped-def]
    """``integers(p, begin, count)`` is an array of 32-bit integers in the memory of p from the index `begin` on."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = builder.gep(parts_of(context, builder, signature.args[0], args[0]).data, [args[1]])
        data = builder.bitcast(data, context.get_data_type(int32).as_pointer())
        return array_over(context, builder, _integers, data, args[2], context.get_constant(intp, 4))

    return _integers(p, int64, int64), codegen


@intrinsic
def floats(typingctx, p, begin, count):  # type: ignore[no-untyped-def]
    """``floats(p, begin, count)`` is an array of floats in the memory of p, which may be written."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = builder.gep(parts_of(context, builder, signature.args[0], args[0]).data, [args[1]])
        return array_over(context, builder, _floats, data, args[2], context.get_constant(intp, 8))

    return _floats(p, int64, int64), codegen


@element
def area(p, place, k):
    """Return the place of an area."""
    return int(p[place + HEAD + k])


@intrinsic
def memory(typingctx, array):  # type: ignore[no-untyped-def]
    """``memory(array)`` is the same array, which may be written: the functions here are compiled for one type only.

    An array of one of several lanes is refused, because its values are not neighbours: members with lists run alone.
    """
    if array.layout != "C":
        raise numba.TypingError("a list of neighbours needs memory of its own for each member")

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        parts = parts_of(context, builder, signature.args[0], args[0])
        return array_over(context, builder, _floats, parts.data, parts.shape[0], context.get_constant(intp, 8))

    return _floats(array), codegen


@element
def refresh(t, u, p, place, d):
    """Copy the positions of the masses, and build the list anew if it may miss a pair.

    In a box that shears, what a point moves with the flow since then counts for the way between two points only.
    """
    if p[place + MARK] != IS_LIST:
        raise ValueError("params must be those of the scene in double precision: lists of neighbours are among them.")
    count, masses, stride = int(p[place + POINTS]), int(p[place + MASSES]), int(p[place + STRIDE])
    x, built = floats(p, area(p, place, X), d * count), floats(p, area(p, place, BUILT), d * count)
    index = integers(p, area(p, place, NUMBER), count)
    worst, strain = 0.0, p[place + SHEAR] * (t - p[place + BUILT_AT])
    for i in range(masses):
        at, square = int(index[i]), 0.0
        for k in range(d):
            now = u[k * stride + at]
            way = now - built[k * count + i]
            if k == 0 and d > 1:
                way -= strain * built[count + i]
            x[k * count + i] = now
            square += way * way
        worst = square if not square <= worst else worst  # NaN stays
    skin = p[place + PRESENT_SKIN]
    limit = (skin - abs(strain) * (p[place + CUTOFF] + skin)) / 2
    if p[place + LISTED] == masses and limit >= 0 and worst <= limit * limit:
        return
    p[place + BUILT_AT], shift = t, p[place + SHEAR] * p[place + BOX + 1] * t
    p[place + TILT] = nearest(shift, p[place + BOX])
    for j in range(d * count):
        built[j] = x[j]
    skin = first_skin(p, place)
    while True:
        sort_by_cells(x, p, place, p[place + CUTOFF] + skin, d)
        begin = np.int64(0)  # for a literal, Numba would compile the function once more
        p[place + LISTED], p[place + PRESENT_SKIN] = build(x, p, place, begin, skin, d), skin
        if p[place + LISTED] == masses or skin == 0:
            return
        skin = skin / 2 if skin > p[place + SKIN] / 4 else 0.0


@element
def first_skin(p, place):
    """Return the skin to be tried first: that of the list, unless it had no room for the last pairs with a skin."""
    masses = int(p[place + MASSES])
    if p[place + PRESENT_SKIN] > 0:
        return p[place + SKIN]
    if p[place + LISTED] < masses:
        return 0.0
    pairs = integers(p, area(p, place, FIRST), masses + 1)[masses]
    return p[place + SKIN] / (1 if 2 * pairs <= p[place + ROOM] else 4)


@element
def listed(p, place, begin, d):
    """Return the number of the first points whose pairs are in the list; below `begin`, they no longer are.

    The pairs of all points before `begin` have been looked at, in this evaluation.
    """
    if begin == 0:
        return int(p[place + LISTED])
    count = int(p[place + POINTS])
    return build(floats(p, area(p, place, X), d * count), p, place, begin, 0.0, d)


@element
def build(x, p, place, begin, skin, d):
    """Write the pairs of the points from `begin` on to the list, within their cutoffs and the skin.

    Return the number of the first point for whose pairs there is no room.
    """
    count, masses, room = int(p[place + POINTS]), int(p[place + MASSES]), int(p[place + ROOM])
    first, mates = integers(p, area(p, place, FIRST), count + 1), integers(p, area(p, place, MATES), room)
    group, has_groups = integers(p, area(p, place, GROUP), count), p[place + HAS_GROUPS] == 1
    apart = integers(p, area(p, place, APART), count + 1)
    apart_mates = integers(p, area(p, place, APART_MATES), int(apart[count]))
    order, bucket = integers(p, area(p, place, ORDER), count), integers(p, area(p, place, BUCKET), count)
    start, mask = integers(p, area(p, place, START), int(p[place + BUCKETS]) + 1), int(p[place + BUCKETS]) - 1
    own, widest = int(p[place + OWN_CUTOFFS]), p[place + CUTOFF]
    # what is read here need not be read again in the loops, in which the list is written
    side_x, side_y, side_z, tilt = p[place + BOX], p[place + BOX + 1], p[place + BOX + 2], p[place + TILT]
    nx, ny, nz = int(p[place + _NUMBERS]), int(p[place + _NUMBERS + 1]), int(p[place + _NUMBERS + 2])
    low_x, high_x = around(nx)
    low_y, high_y = around(ny)
    low_z, high_z = around(nz)
    k = 0
    for i in range(begin, masses):
        first[i] = low = k
        if bucket[i] < 0:
            continue
        cx = cell(x, p, place, 0, i, d)
        cy = cell(x, p, place, 1, i, d)
        cz = cell(x, p, place, 2, i, d)
        x_here, y_here, z_here = x[i], x[count + i] if d > 1 else 0.0, x[2 * count + i] if d > 2 else 0.0
        for oz in range(low_z, high_z):
            for oy in range(low_y, high_y):
                row = _ROW * within(cy + oy, ny) + _LAYER * within(cz + oz, nz)
                c = (row + cx) & mask
                in_row = 0 < c < mask and (nx == 0 or 0 < cx < nx - 1)  # three buckets follow each other
                for ox in range(0 if in_row else low_x, 1 if in_row else high_x):
                    c = c if in_row else (row + within(cx + ox, nx)) & mask
                    for q in range(start[c - in_row], start[c + 1 + in_row]):
                        j = int(order[q])
                        if j <= i or (has_groups and group[i] == group[j]):
                            continue
                        square, turns = 0.0, 0.0
                        if d > 1:
                            way = x[count + j] - y_here
                            turns = np.rint(way / side_y) if side_y > 0 else 0.0
                            square = (way - side_y * turns) ** 2
                        way = nearest(x[j] - x_here - tilt * turns, side_x)
                        square += way * way
                        if d > 2:
                            way = nearest(x[2 * count + j] - z_here, side_z)
                            square += way * way
                        reach = (1 + _ULPS) * (skin + (p[own + i] + p[own + j] if own > 0 else widest))
                        if square < reach * reach and not is_apart(apart, apart_mates, i, j):
                            if k == room:
                                k = sort(mates, low, k)
                                if k == room:
                                    return i
                            mates[k] = j
                            k += 1
        k = sort(mates, low, k)
    for i in range(masses, count + 1):
        first[i] = k
    return masses


@element
def nearest(way, side):
    """Return the way to the nearest image along an axis, which may be periodic."""
    return way - side * np.rint(way / side) if side > 0 else way


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


@element
def sort_by_cells(x, p, place, size, d):
    """Sort the points by the buckets of their cells, which are at least as long as `size`."""
    count, buckets = int(p[place + POINTS]), int(p[place + BUCKETS])
    order, bucket = integers(p, area(p, place, ORDER), count), integers(p, area(p, place, BUCKET), count)
    start = integers(p, area(p, place, START), buckets + 1)
    divide(x, p, place, size, d)
    for c in range(buckets + 1):
        start[c] = 0
    for i in range(count):
        bucket[i] = -1
        sum_of_all = 0.0
        for k in range(d):
            sum_of_all += abs(x[k * count + i])
        if sum_of_all < math.inf:  # a point without a place is near to none
            row = _ROW * cell(x, p, place, 1, i, d) + _LAYER * cell(x, p, place, 2, i, d)
            c = (row + cell(x, p, place, 0, i, d)) & (buckets - 1)
            bucket[i] = c
            start[c] += 1
    end = 0
    for c in range(buckets + 1):
        end += start[c]
        start[c] = end
    for i in range(count - 1, -1, -1):
        c = int(bucket[i])
        if c >= 0:
            start[c] -= 1
            order[start[c]] = i


@element
def divide(x, p, place, size, d):
    """Choose the cells. They fill the periodic box, or are without end."""
    count, head = int(p[place + POINTS]), floats(p, place, HEAD)
    for k in range(3):
        head[_NUMBERS + k] = 1.0
    size *= 1 + _ROUND_OFF
    for k in range(d):
        side = head[BOX + k]
        if side > 0:
            slant = p[place + TILT] / head[BOX + 1] if k == 0 and p[place + TILT] != 0 else 0.0
            number = math.floor(min(side / (size * math.sqrt(1 + slant * slant)), _CELLS))
            number = number if number >= 3 else 1.0
            head[_NUMBERS + k], head[_LOWS + k], head[_SCALES + k] = number, 0.0, number / side
        else:
            low, length = region(x[k * count : (k + 1) * count], floats(p, place + SOME, _SAMPLES))
            scale = 1 / max(size, length / _CELLS)
            head[_NUMBERS + k], head[_LOWS + k], head[_SCALES + k] = 0.0, low, scale


@element
def cell(x, p, place, k, i, d):
    """Return the number of the cell of a point along an axis."""
    if k >= d:
        return 0
    count, tilt = int(p[place + POINTS]), p[place + TILT]
    along = x[k * count + i] - p[place + _LOWS + k]
    if k == 0 and tilt != 0:  # then there are more dimensions, and a side along y
        along -= tilt / p[place + BOX + 1] * x[count + i]
    along *= p[place + _SCALES + k]
    number = p[place + _NUMBERS + k]
    if number > 0:
        return int(min(along - number * np.floor(along / number), number - 1))
    return math.floor(min(max(along, -_FAR), _FAR))


@element
def region(x, some):
    """Return the middle and the length of a range with most of the values, from those that are copied to `some`."""
    count = 0
    for k in range(len(some)):
        value = x[k * len(x) // len(some)]
        if abs(value) < math.inf:
            some[count] = value
            count += 1
    count = sort(some, 0, count)
    if count == 0:
        return 0.0, 0.0
    return some[count // 2], min(some[count - 1 - count // _PART] - some[count // _PART], _LARGEST)


def _kept(function: Any) -> Any:
    """Decorate a function that scenes call, and that is kept on the disk."""
    return keep_on_disk(numba.njit(**KERNEL_OPTIONS)(function))


@_kept
def refresh_1d(t, u, p, place):
    """Call `refresh` in one dimension."""
    return refresh(t, u, p, place, 1)


@_kept
def refresh_2d(t, u, p, place):
    """Call `refresh` in two dimensions."""
    return refresh(t, u, p, place, 2)


@_kept
def refresh_3d(t, u, p, place):
    """Call `refresh` in three dimensions."""
    return refresh(t, u, p, place, 3)


@_kept
def listed_1d(p, place, begin):
    """Call `listed` in one dimension."""
    return listed(p, place, begin, 1)


@_kept
def listed_2d(p, place, begin):
    """Call `listed` in two dimensions."""
    return listed(p, place, begin, 2)


@_kept
def listed_3d(p, place, begin):
    """Call `listed` in three dimensions."""
    return listed(p, place, begin, 3)


#: `refresh` and `listed`, by the number of dimensions.
FUNCTIONS = {1: (refresh_1d, listed_1d), 2: (refresh_2d, listed_2d), 3: (refresh_3d, listed_3d)}
