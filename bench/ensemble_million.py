"""A million Duffing oscillators in bounded memory: `python -m eig3.bench.ensemble_million [MEMBERS [STEPS]]`."""

import resource
import sys
import time
from typing import Any

import numpy as np

from .ensemble_cases import CASES


def furthest(part: Any) -> float:
    """The largest displacement at the end of a part of the ensemble."""
    return float(np.abs(part.u[:, -1]).max())


def main(m: int = 1_000_000, n_steps: int = 10_000) -> None:
    case = CASES["duffing"]
    begin = time.perf_counter()
    parts = case.problem.ensemble(**case.members(m), h=case.h, t_end=n_steps * case.h, save_every=None, reduce=furthest)
    seconds = time.perf_counter() - begin
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # Linux counts in kB
    print(
        f"{m} members of {n_steps} steps in {len(parts)} parts: {seconds:.3g} s, at most {megabytes:.0f} MB of memory, "
        f"largest displacement at the end {max(parts):.4g} m"
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
