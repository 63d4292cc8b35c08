"""Lists of the points that are near each other, kept in the memory that a run has at the end of its parameters.

A list has the pairs within their cutoff and a skin. It is valid until a point has moved by half of the skin; then it is
built anew from cells. Pairs beyond their cutoff do not act, and those that act are in the order of their points. So the
forces have the same bits whenever the list was built: it is a memo, and a run may go on from any copy of it.

The method is that of L. Verlet, Physical Review 159 (1967), with the cells of R. W. Hockney and J. W. Eastwood,
Computer Simulation Using Particles (1981).

All numbers are in p, from the index `place` on: first the numbers below, then the areas that `Areas` names. The number
of dimensions d is a constant in each of the three functions at the end, so that the compiler unrolls the loops over it.
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
#: 0; and the number of pairs and of cells for which there is room.
POINTS, MASSES, STRIDE, SKIN, HAS_GROUPS, CUTOFF, OWN_CUTOFFS, ROOM, CELLS = range(9)
#: The sides of the periodic box, 0 for none; 1 if the list is valid, and the skin that it has; and room for the grid of
#: cells and for some positions.
BOX, IS_VALID, PRESENT_SKIN, GRID, SOME = 9, 12, 13, 14, 23
_SAMPLES = 64  # points, from which the region of the cells is chosen
HEAD = SOME + _SAMPLES

#: The areas, in the order of `Areas`.
X, BUILT, FIRST, MATES, NUMBER, GROUP, APART, APART_MATES, ORDER, CELL, START = range(11)

_PART = 12  # a part of 1/12 of them may lie beyond it at each end
_MARGIN = 0.25  # of the region beyond these points, as a part of its length


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
    order, cell, start : int
        The points by their cells, the cell of each point, and where each cell begins.
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
    cell: int
    start: int

    @classmethod
    def of(cls, place: int, points: int, room: int, cells: int, n_apart: int, dimension: int) -> tuple[Areas, int]:
        """Return the areas of a list at a place of p, and where they end."""
        floats = [dimension * points] * 2
        integers = [points + 1, room, points, points, points + 1, n_apart, points, points, cells + 1]
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


@element
def refresh(u, p, place, d):
    """Copy the positions of the masses, build the list anew if it may miss a pair, and return whether it has room."""
    count, masses, stride = int(p[place + POINTS]), int(p[place + MASSES]), int(p[place + STRIDE])
    head = floats(p, place, HEAD)
    x, built = floats(p, area(p, place, X), d * count), floats(p, area(p, place, BUILT), d * count)
    index = integers(p, area(p, place, NUMBER), count)
    worst = 0.0
    for i in range(masses):
        at, square = int(index[i]), 0.0
        for k in range(d):
            now = u[k * stride + at]
            way = now - built[k * count + i]
            x[k * count + i] = now
            square += way * way
        worst = square if not square <= worst else worst  # NaN stays
    limit = head[PRESENT_SKIN] / 2
    if head[IS_VALID] == 1 and worst <= limit * limit:
        return True
    for j in range(d * count):
        built[j] = x[j]
    skin = head[SKIN]
    while not build(x, p, place, skin, d):
        if skin == 0:
            head[IS_VALID] = 0.0
            return False
        skin = skin / 2 if skin > head[SKIN] / 4 else 0.0
    head[PRESENT_SKIN], head[IS_VALID] = skin, 1.0
    return True


@element
def build(x, p, place, skin, d):
    """Write the pairs within their cutoffs and the skin to the list; return whether there is room for them."""
    count, masses, room = int(p[place + POINTS]), int(p[place + MASSES]), int(p[place + ROOM])
    first, mates = integers(p, area(p, place, FIRST), count + 1), integers(p, area(p, place, MATES), room)
    group, has_groups = integers(p, area(p, place, GROUP), count), p[place + HAS_GROUPS] == 1
    apart = integers(p, area(p, place, APART), count + 1)
    apart_mates = integers(p, area(p, place, APART_MATES), int(apart[count]))
    order, cell = integers(p, area(p, place, ORDER), count), integers(p, area(p, place, CELL), count)
    start = integers(p, area(p, place, START), int(p[place + CELLS]) + 1)
    box, own, widest = place + BOX, int(p[place + OWN_CUTOFFS]), p[place + CUTOFF]
    nx, ny, nz = sort_by_cells(x, p, place, widest + skin, order, cell, start, d)
    k = 0
    for i in range(masses):
        first[i] = begin = k
        c = int(cell[i])
        cx, cy, cz = c % nx, (c // nx) % ny, c // (nx * ny)
        low_z, high_z = around(cz, nz, p[box + 2])
        low_y, high_y = around(cy, ny, p[box + 1])
        low_x, high_x = around(cx, nx, p[box])
        for oz in range(low_z, high_z):
            for oy in range(low_y, high_y):
                row = (within(cz + oz, nz) * ny + within(cy + oy, ny)) * nx
                for ox in range(low_x, high_x):
                    c = row + within(cx + ox, nx)
                    for q in range(start[c], start[c + 1]):
                        j = int(order[q])
                        if j <= i or (has_groups and group[i] == group[j]):
                            continue
                        square = 0.0
                        for axis in range(d):
                            way, side = x[axis * count + j] - x[axis * count + i], p[box + axis]
                            if side > 0:
                                way -= side * np.rint(way / side)
                            square += way * way
                        reach = skin + (p[own + i] + p[own + j] if own > 0 else widest)
                        if square < reach * reach and not is_apart(apart, apart_mates, i, j):
                            if k == room:
                                return False
                            mates[k] = j
                            k += 1
        sort(mates, begin, k)
    for i in range(masses, count + 1):
        first[i] = k
    return True


@element
def is_apart(apart, mates, i, j):
    """Return whether a pair is left out."""
    found = False
    for q in range(apart[i], apart[i + 1]):
        found |= mates[q] == j
    return found


@element
def around(c, count, side):
    """Return the range of steps from a cell to those beside it along an axis. A periodic one has 1 cell, or many."""
    if side > 0:
        return (-1, 2) if count > 1 else (0, 1)
    return (-1 if c > 0 else 0), (2 if c < count - 1 else 1)


@element
def within(c, count):
    """Return the index of a cell, which is periodic."""
    return c + count if c < 0 else (c - count if c >= count else c)


@element
def sort(values, begin, end):
    """Sort a few neighbouring values."""
    for q in range(begin + 1, end):
        value, k = values[q], q
        while k > begin and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value


@element
def sort_by_cells(x, p, place, size, order, cell, start, d):
    """Sort the points by cells at least as long as `size`, and return the numbers of cells along the axes.

    The cells fill the periodic box, or the region of most points. A point beyond it belongs to the cell at its edge:
    two points in reach of each other are in neighbouring cells then too.
    """
    count, room = int(p[place + POINTS]), p[place + CELLS]
    numbers, lows, lengths = floats(p, place + GRID, 3), floats(p, place + GRID + 3, 3), floats(p, place + GRID + 6, 3)
    for k in range(3):
        numbers[k] = 1.0
    for k in range(d):
        lows[k], lengths[k] = 0.0, p[place + BOX + k]
        if lengths[k] == 0:
            lows[k], lengths[k] = region(x[k * count : (k + 1) * count], floats(p, place + SOME, _SAMPLES))
    while True:
        for k in range(d):
            numbers[k] = max(1.0, math.floor(min(lengths[k] / size, room)))
            if p[place + BOX + k] > 0 and numbers[k] < 3:
                numbers[k] = 1.0
        if numbers[0] * numbers[1] * numbers[2] <= room:
            break
        size *= 1.25
    total = int(numbers[0] * numbers[1] * numbers[2])
    for c in range(total + 1):
        start[c] = 0
    for i in range(count):
        c, rows = 0, 1
        for k in range(d):
            part = (x[k * count + i] - lows[k]) / lengths[k]
            if p[place + BOX + k] > 0:
                part -= math.floor(part)
            along = part * numbers[k]
            along = along if along > 0 else 0.0  # also for NaN
            c += rows * int(min(along, numbers[k] - 1))
            rows *= int(numbers[k])
        cell[i] = c
        start[c + 1] += 1
    for c in range(total):
        start[c + 1] += start[c]
    for i in range(count - 1, -1, -1):
        c = int(cell[i])
        start[c + 1] -= 1
        order[start[c + 1]] = i
    for c in range(total):  # now cell c begins at start[c + 1]
        start[c] = start[c + 1]
    start[total] = count
    return int(numbers[0]), int(numbers[1]), int(numbers[2])


@element
def region(x, some):
    """Return the begin and the length of a range with most of the values, from those that are copied to `some`."""
    count = min(len(x), len(some))
    for k in range(count):
        some[k] = x[k * len(x) // count]
    sort(some, 0, count)
    low, high = some[count // _PART], some[count - 1 - count // _PART]
    margin = _MARGIN * (high - low)
    length = high - low + 2 * margin
    is_range = 0 < length < math.inf
    return (low - margin if is_range else 0.0), (length if is_range else 1.0)


def _kept(function: Any) -> Any:
    """Decorate a function that scenes call, and that is kept on the disk."""
    return keep_on_disk(numba.njit(**KERNEL_OPTIONS)(function))


@_kept
def refresh_1d(u, p, place):
    """Call `refresh` in one dimension."""
    return refresh(u, p, place, 1)


@_kept
def refresh_2d(u, p, place):
    """Call `refresh` in two dimensions."""
    return refresh(u, p, place, 2)


@_kept
def refresh_3d(u, p, place):
    """Call `refresh` in three dimensions."""
    return refresh(u, p, place, 3)


REFRESH = {1: refresh_1d, 2: refresh_2d, 3: refresh_3d}
