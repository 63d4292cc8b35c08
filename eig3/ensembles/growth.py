"""Whether members grew because of their step: first all of a block together, then those in doubt alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..stepper import Cancel
from .lane_state import LaneState
from .shared import Shared

_SAME = 2.0  # sizes of a motion with h and with h/2 within this factor are a property of the system, not of the step
_STEPS = 4096  # of the kernel before it is asked whether to stop
_NEVER = 2**62


def grown_by_step(shared: Shared, members: np.ndarray, sizes: np.ndarray, stop: Cancel) -> np.ndarray:
    """Return the members that may have grown because of their step.

    Parameters
    ----------
    shared : Shared
    members : ndarray of int, shape (k,)
        Members of one block, which have grown much.
    sizes : ndarray, shape (2, k)
        Their largest |u| and |v| at the end.
    stop : Cancel

    Notes
    -----
    The members run again with half the step. A growth because of the step changes with it by orders of magnitude. A
    member alone would need its critical steps to tell, which takes longer than thousands of steps in lanes.
    """
    everyone, lanes = shared.members, shared.layout.lanes
    halved = replace(shared, members=replace(everyone, h=everyone.h / 2, n_steps=2 * everyone.n_steps))
    state = LaneState(halved, members[np.arange(lanes) % len(members)])
    ends = halved.members.n_steps[members]
    halved_sizes = np.full_like(sizes, np.nan)
    for end in np.unique(ends).tolist():
        while state.index < end and not stop.is_set():
            state.advance(min(end, state.index + _STEPS), _NEVER)
        here = np.flatnonzero(ends == end)
        halved_sizes[:, here] = np.array(state.sizes)[:, here]
    with np.errstate(all="ignore"):
        same = (halved_sizes < _SAME * sizes) & (sizes < _SAME * halved_sizes) | (sizes == halved_sizes)
    return members[~same.all(axis=0)]
