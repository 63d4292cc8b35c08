"""Let threads share the work of a scene: its lists of neighbours, the forces of their pairs, and all others."""

from numba.types import int64

from .compile.jit import code_address, element
from .grains import IN_TURN, IS_FULL, take_next, write_in_turn
from .neighbours import BEGIN, CHECK, FINISH, PARTS, REFRESH
from .team import THREADS, board_at, board_of, share_at, together

#: What the threads share: all forces except the pair forces of the lists, and then, from LISTS + STAGES times the
#: number of a list on, the stages of `update`, `add_forces` and `advance_springs`.
OWN, LISTS = 0, 1
SCANNING, BUILDING, ACTING, ADVANCING = range(4)
STAGES = 4


@element
def set_forces(share, t, u, v, p, a, team):
    """Set a to the accelerations by all forces except pair forces, with the threads of the team in p, if any.

    ``share(stage, part, parts, t, u, v, p, a)`` does a part of a stage. It is called at its address, as in the other
    functions: there is one copy of its code.
    """
    do, board = share_at(code_address(share)), board_of(p, team)
    if board == 0:
        do(OWN, 0, 1, t, u, v, p, a)
    else:
        together(do, board, OWN, board_at(board)[THREADS], t, u, v, p, a)


@element
def update(do, lists, number, board, t, u, v, p, a, place):
    """Bring a list up to date; return the number of its parts. The list has this `number` and `place`."""
    first = LISTS + number * STAGES
    if board == 0:
        lists(REFRESH, t, u, p, place, place, place)
        return int64(p[place + PARTS])
    parts = board_at(board)[THREADS]  # more of them would share more pairs
    together(do, board, first + SCANNING, parts, t, u, v, p, a)
    if lists(CHECK, t, u, p, place, place, parts) == 0:
        lists(BEGIN, t, u, p, place, place, parts)
        while True:
            together(do, board, first + BUILDING, int64(p[place + PARTS]), t, u, v, p, a)
            if lists(FINISH, t, u, p, place, place, place) == 1:
                break
    return int64(p[place + PARTS])


@element
def add_forces(share, lists, number, t, u, v, p, a, place, team):
    """Bring a list up to date, and add the forces of its pairs to a."""
    do, board = share_at(code_address(share)), board_of(p, team)
    parts = update(do, lists, number, board, t, u, v, p, a, place)
    stage = LISTS + number * STAGES + ACTING
    if board == 0:
        for part in range(parts):
            do(stage, part, parts, t, u, v, p, a)
    else:
        together(do, board, stage, parts, t, u, v, p, a)


@element
def advance_springs(share, lists, number, t, u, v, p, place, springs, team):
    """Write the springs between grains in a state to their other table, which is at `springs`, and take it."""
    do, board, stage = share_at(code_address(share)), board_of(p, team), LISTS + number * STAGES + ADVANCING
    parts = update(do, lists, number, board, t, u, v, p, u, place)
    p[springs + IN_TURN] = p[springs + IS_FULL] = 0.0
    if board != 0:
        together(do, board, stage, parts, t, u, v, p, u)
    if board == 0 or p[springs + IS_FULL] == 1:
        write_in_turn(p, springs)
        for part in range(parts):
            do(stage, part, parts, t, u, v, p, u)
    take_next(t, p, springs)
