"""Whether members grew because of their step: a run with half the step shows it for all lanes of a block at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..stepping.march import NEVER, Cancel
from .block_setup import BlockSetup
from .lane_state import LaneState


def sizes_with_half_the_step(shared: BlockSetup, members: np.ndarray, stop: Cancel) -> np.ndarray:
    """Return the largest |u| and |v| at the end of members that run again with half the step.

    Parameters
    ----------
    shared : BlockSetup
    members : ndarray of int, shape (lanes,)
        They end after the same number of steps.
    stop : Cancel

    Returns
    -------
    ndarray, shape (2, lanes)
    """
    everyone = shared.members
    halved = replace(shared, members=replace(everyone, h=everyone.h / 2, n_steps=2 * everyone.n_steps))
    state, end = LaneState(halved, members), int(halved.members.n_steps[members[0]])
    state.advance(end, NEVER, stop)
    return np.array(state.sizes)
