"""Let threads share a list of neighbours, and the forces between its points."""

from .compile.jit import element
from .neighbours import BEGIN, CHECK, FINISH, PARTS, REFRESH
from .team import THREADS, board_at, board_of, together

#: What the threads share of each list, the number of which they multiply by STAGES: the stages of `add_forces`.
SCANNING, BUILDING, ACTING = range(3)
STAGES = 3


@element
def add_forces(share, lists, number, t, u, v, p, a, place, team):
    """Bring a list up to date, and add the forces of its pairs to a, with the threads of the team in p, if any.

    `number` and `place` are those of the list, and ``share(stage, part, parts, t, u, v, p, a)`` does a part of a stage.
    """
    board, first = board_of(p, team), number * STAGES
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
