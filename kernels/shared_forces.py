"""Let threads share the forces of a scene: its lists of neighbours, the forces of their pairs, and all others."""

from .compile.jit import element
from .neighbours import BEGIN, CHECK, FINISH, PARTS, REFRESH
from .team import THREADS, board_at, board_of, together

#: What the threads share: all forces but those of the lists, and then, from LISTS + STAGES times the number of a list
#: on, the stages of `add_forces`.
OWN, LISTS = 0, 1
SCANNING, BUILDING, ACTING = range(3)
STAGES = 3


@element
def set_forces(share, t, u, v, p, a, team):
    """Set a to the accelerations by all forces but those of the lists, with the threads of the team in p, if any.

    ``share(stage, part, parts, t, u, v, p, a)`` does a part of a stage.
    """
    board = board_of(p, team)
    if board == 0:
        share(OWN, 0, 1, t, u, v, p, a)
    else:
        together(share, board, OWN, board_at(board)[THREADS], t, u, v, p, a)


@element
def add_forces(share, lists, number, t, u, v, p, a, place, team):
    """Bring a list up to date, and add the forces of its pairs to a. `number` and `place` are those of the list."""
    board, first = board_of(p, team), LISTS + number * STAGES
    if board == 0:
        lists(REFRESH, t, u, p, place, place, place)
        parts = int(p[place + PARTS])
        for part in range(parts):
            share(first + ACTING, part, parts, t, u, v, p, a)
        return
    parts = board_at(board)[THREADS]  # more of them would share more pairs
    together(share, board, first + SCANNING, parts, t, u, v, p, a)
    if lists(CHECK, t, u, p, place, place, parts) == 0:
        lists(BEGIN, t, u, p, place, place, parts)
        while True:
            together(share, board, first + BUILDING, int(p[place + PARTS]), t, u, v, p, a)
            if lists(FINISH, t, u, p, place, place, place) == 1:
                break
    together(share, board, first + ACTING, int(p[place + PARTS]), t, u, v, p, a)
