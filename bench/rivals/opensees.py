"""OpenSees on an elastic cube and on the frame that yields. It needs `openseespy`, BLAS and LAPACK."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eig3.problem import Problem
from eig3.problems.yielding_frame import BAY, BAYS, BEAM, COLUMN, STOREY, STOREYS, joint

from ..solids import POISSON, YOUNG

_ITERATIONS, _CHANGE = 100, 1e-6  # m; a larger change costs more accuracy than time

#: For each method of the frame, the fastest algorithm that always converges, of Newton's and its variants, and the
#: integrator. The matrix of the central difference is constant: the damping is, and the mass.
FRAME_METHODS: dict[str, tuple[tuple[str, ...], tuple[Any, ...]]] = {
    "Newmark": (("KrylovNewton",), ("Newmark", 0.5, 0.25)),
    "CentralDifference": (("Linear", "-factorOnce"), ("CentralDifference",)),
}


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


def frame_run(problem: Problem, method: str, h: float, steps: int) -> Callable[[], float]:
    """Return a run of `problems.yielding_frame`; its value is the time of the steps."""

    def run() -> float:
        _frame(problem, method)
        begin = time.perf_counter()
        if _module().analyze(steps, h):
            raise RuntimeError("OpenSees did not converge.")
        return time.perf_counter() - begin

    return run


def frame_history(problem: Problem, method: str, h: float, every: int, rows: int) -> np.ndarray:
    """Return the displacements of the joints after each so many steps, shape (rows, names), from a run as above.

    `frame_names` names the columns. Rows after a step that does not converge are NaN.
    """
    ops, tags = _module(), _frame(problem, method)
    found = np.full((rows, len(frame_names(problem))), np.nan)
    for row in range(rows):
        if row and ops.analyze(every, h):
            break
        found[row] = [ops.nodeDisp(tags[name.partition(".")[0]], 1) for name in frame_names(problem)]
    return found


def frame_names(problem: Problem) -> list[str]:
    """Return the names of the horizontal displacements of the joints."""
    return [name for name in problem.names if name.endswith(".ux")]


def _frame(problem: Problem, method: str) -> dict[str, int]:
    """Build the frame of `problems.yielding_frame`, and return the numbers of its joints."""
    ops, p, masses = _module(), problem.params, dict(zip(problem.names, problem.params.m, strict=True))
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    tags: dict[str, int] = {}

    def node(name: str, x: float, y: float, mass: list[float]) -> int:
        tags[name] = len(tags) + 1
        ops.node(tags[name], x, y)
        ops.mass(tags[name], *mass)
        return tags[name]

    for level, line in np.ndindex(STOREYS + 1, BAYS + 1):
        name, is_base = joint(level, line), level == 0
        mass = [0.0] * 3 if is_base else [float(masses[f"{name}.{axis}"]) for axis in ("ux", "uy", "rz")]
        node(name, line * BAY, level * STOREY, mass)
        if is_base:
            ops.fix(tags[name], 1, 1, 1)
    places = {name: ops.nodeCoord(tag) for name, tag in tags.items()}
    members = [(joint(level - 1, line), joint(level, line), COLUMN) for level, line in _joints(0)] + [
        (joint(level, line - 1), joint(level, line), BEAM) for level, line in _joints(1)
    ]
    hinges = {name: k for k, name in enumerate(n for n in problem.names if ".rz_" in n)}
    for number, (start, end, section) in enumerate(members, start=1):
        ends = []
        for at, side in ((start, "start"), (end, "end")):
            name = f"{start}-{end}.rz_{side}"
            if name not in hinges:
                ends.append(tags[at])
                continue
            k, (x, y) = hinges[name], places[at]
            tag = node(name, x, y, [0.0, 0.0, float(masses[name])])
            law = [p.link_0_yield_force[k], p.link_0_stiffness[k], p.link_0_hardening[k]]
            ops.uniaxialMaterial("Steel01", tag, *map(float, law))
            ops.equalDOF(tags[at], tag, 1, 2)
            ops.element("zeroLength", 1000 + tag, tags[at], tag, "-mat", tag, "-dir", 6)
            ends.append(tag)
        ops.element("elasticBeamColumn", number, *ends, *(section[x] for x in "AEI"), 1)
    ops.region(1, "-ele", *range(1, len(members) + 1), "-rayleigh", float(p.a), float(p.b), 0.0, 0.0)
    every = float(p.ground_times[1] - p.ground_times[0])
    ops.timeSeries("Path", 1, "-dt", every, "-values", *p.ground.tolist(), "-factor", 1.0)
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    algorithm, integrator = FRAME_METHODS[method]
    ops.system("BandSPD")
    ops.test("NormDispIncr", _CHANGE, _ITERATIONS)
    ops.algorithm(*algorithm)
    ops.integrator(*integrator)
    ops.analysis("Transient")
    return tags


def _joints(first_line: int) -> Iterator[tuple[int, int]]:
    """The levels and lines of the joints above the ground, from a line on."""
    return ((level, line) for level in range(1, STOREYS + 1) for line in range(first_line, BAYS + 1))
