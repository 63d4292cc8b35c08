"""OpenSees on an elastic cube and on the ten-storey frame. It needs `openseespy`, and the libraries BLAS and LAPACK."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..solids import POISSON, YOUNG


@functools.cache
def _module() -> Any:
    try:
        import openseespy.opensees as module
    except (ImportError, RuntimeError):  # RuntimeError if a system library is missing
        return None
    return module


def is_there() -> bool:
    return _module() is not None


def version() -> str:
    return _module().version() if is_there() else "not installed: pip install openseespy"


def cube_run(side: int, method: str, h: float, steps: int) -> Callable[[], float]:
    """Return a run of the next steps on a cube whose free side is pulled, with lumped masses."""

    def run() -> float:
        _cube(side, method)
        _module().analyze(1, h)  # the first step builds and factors the matrices
        begin = time.perf_counter()
        failed = _module().analyze(steps, h)
        if failed:
            raise RuntimeError(f"OpenSees ended with the code {failed}.")
        return time.perf_counter() - begin

    return run


def _cube(side: int, method: str) -> None:
    ops, n = _module(), side + 1
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    number = np.arange(1, n**3 + 1).reshape(n, n, n)
    for place in np.ndindex(n, n, n):
        tag = int(number[place])
        ops.node(tag, *(x / side for x in place))
        shares = np.prod([1 if x in (0, side) else 2 for x in place]) / 8
        ops.mass(tag, *[float(shares / side**3)] * 3)
        if place[0] == 0:
            ops.fix(tag, 1, 1, 1)
    ops.nDMaterial("ElasticIsotropic", 1, YOUNG, POISSON)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    for element, place in enumerate(np.ndindex(side, side, side), start=1):
        ends = [int(number[tuple(np.add(place, corner))]) for corner in corners]
        ops.element("stdBrick", element, *ends, 1)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    for tag in number[-1].ravel():
        ops.load(int(tag), 1.0, 0.0, 0.0)
    ops.constraints("Plain")
    ops.numberer("RCM")
    if method == "Newmark":
        ops.system("UmfPack")
        ops.algorithm("Linear", "-factorOnce")
        ops.integrator("Newmark", 0.5, 0.25)
    else:
        ops.system("Diagonal")
        ops.algorithm("Linear")
        ops.integrator(method)
    ops.analysis("Transient")
