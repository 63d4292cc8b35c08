"""The springs along the surfaces of grains that touch each other. They are kept in p, with the state of a run.

A contact has a tangential spring, whose force e grows with the tangential velocity w of the surfaces: e' = k w, with a
stiffness k that may depend on the indentation. Where k falls, e falls with it, so that a contact that opens gives back
no more energy than it has taken: C. Thornton, S. J. Cummins and P. W. Cleary, Powder Technology 233 (2013). e is at
most Coulomb's limit, as in P. A. Cundall and O. D. L. Strack, Geotechnique 29 (1979).

A table has e, its rate k w and k of each contact at the end of the last step, at the time t_c. In a state at the time t

    e = min(1, k / k_c) e_c + (t - t_c) / 2 (k_c w_c + k w)

turned into the present tangential plane and cut to the limit. So a trial state changes nothing, and the order is two.
There are two tables: the next one is written while this one is read. The contacts of a mass, with mates of larger
numbers, are in the order of the list of neighbours, which may be built anew meanwhile. Threads that share the grains
write to parts of the next table; if one of them is full, they continue one after the other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .compile.jit import element
from .neighbours import bounds
from .protocol import index

#: The numbers before the tables: the time t_c; which table has this time; and of the next table, whether its parts
#: are written one after the other, how many contacts it has then, and whether a part had no room.
TIME, TABLE, IN_TURN, COUNT, IS_FULL = range(5)
HEAD = 5
#: The numbers of a contact: e and k w, each as a vector, and k.
VALUES = 7


class Table(NamedTuple):
    """The places of a table, from its begin on.

    Where the contacts of each mass begin is first.

    Attributes
    ----------
    ends, mates, values, size : int
        Where the contacts of each mass end, the mates of contacts, and their numbers.
    """

    ends: int
    mates: int
    values: int
    size: int

    @classmethod
    def of(cls, masses: int, room: int) -> Table:
        """Return the places for a number of masses and of contacts."""
        ends = (masses + 1) // 2
        mates = 2 * ends
        values = mates + (room + 1) // 2
        return cls(ends, mates, values, values + VALUES * room)


@element
def turned(ex, ey, ez, nx, ny, nz):
    """Turn a vector into the plane across the unit vector n. Its length stays the same."""
    along = ex * nx + ey * ny + ez * nz
    x, y, z = ex - along * nx, ey - along * ny, ez - along * nz
    across = x * x + y * y + z * z
    if across == 0.0:
        return 0.0, 0.0, 0.0
    scale = math.sqrt((ex * ex + ey * ey + ez * ez) / across)
    return scale * x, scale * y, scale * z


@element
def stretched(held, h, since, k, wx, wy, wz, nx, ny, nz, limit):
    """Return the force of a spring at the time `since` after the time of its table; it is new if h is negative."""
    half = since / 2
    ex = ey = ez = 0.0
    if h >= 0:
        first = VALUES * h
        before = held[first + 6]
        part = k / before if k < before else 1.0
        ex = part * held[first] + half * held[first + 3]
        ey = part * held[first + 1] + half * held[first + 4]
        ez = part * held[first + 2] + half * held[first + 5]
        ex, ey, ez = turned(ex, ey, ez, nx, ny, nz)
    ex, ey, ez = ex + half * k * wx, ey + half * k * wy, ez + half * k * wz
    return within_limit(ex, ey, ez, limit)


@element
def within_limit(fx, fy, fz, limit):
    """Shorten a force to Coulomb's limit."""
    square = fx * fx + fy * fy + fz * fz
    if square <= limit * limit:
        return fx, fy, fz
    part = limit / math.sqrt(square)
    return part * fx, part * fy, part * fz


@element
def found(mates, h, end, mate):
    """Return the place of a mate among those from h to end, in ascending order, or of the next one."""
    while h < end and mates[h] < mate:
        h += 1
    return h


@element
def write_in_turn(kept, springs):
    """Let the parts of the next table be written one after the other, from its begin on."""
    kept[springs + IN_TURN], kept[springs + COUNT] = 1.0, 0.0


@element
def room_of(kept, springs, room, part, parts):
    """Return the places of the next table where the contacts of a part begin, and where they must end."""
    if kept[springs + IN_TURN] == 1:
        return index(kept[springs + COUNT]), index(room)
    begin, end = bounds(room, part, parts)
    return index(begin), index(end)


@element
def end_part(kept, springs, count):
    """Note where the contacts of a part end, if another part follows."""
    if kept[springs + IN_TURN] == 1:
        kept[springs + COUNT] = count


@element
def hold(mates, values, count, mate, ex, ey, ez, k, wx, wy, wz):
    """Write a contact to a table."""
    mates[count] = np.int32(mate)
    first = VALUES * count
    values[first], values[first + 1], values[first + 2] = ex, ey, ez
    values[first + 3], values[first + 4], values[first + 5] = k * wx, k * wy, k * wz
    values[first + 6] = k


@element
def refuse(kept, springs):
    """Note that there is no room for a contact: parts are then written in turn. If they were, it is an error."""
    kept[springs + IS_FULL] = 1.0
    if kept[springs + IN_TURN] == 1:
        raise ValueError(
            "more grains touch each other than there is room for: give neighbor_capacity=, the contacts of a grain."
        )


@element
def take_next(t, kept, springs):
    """Take the next table, whose time is t."""
    kept[springs + TIME], kept[springs + TABLE] = t, 1.0 - kept[springs + TABLE]


#: The functions that the code of scenes calls.
FUNCTIONS = {
    "stretched": stretched,
    "within_limit": within_limit,
    "found": found,
    "write_in_turn": write_in_turn,
    "room_of": room_of,
    "end_part": end_part,
    "hold": hold,
    "refuse": refuse,
    "take_next": take_next,
}
