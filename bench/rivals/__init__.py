"""Solvers that a user could choose instead, each with its best settings, on the same problems.

Every rival returns the states at given times: by its own dense output if it has one, and else by steps that end there.
The whole call is timed, without compilation.
"""

from functools import partial
from typing import Any

from .expressions import EXPRESSIONS
from .general import cyrk, scipy, verlet
from .rebound import DIMENSIONS, ORBITS, ias15, whfast
from .rival import Rival, without_events, without_velocity
from .symbolic import diffrax, heyoka

_HEYOKA = tuple(10.0**-k for k in (3, 5, 7, 9, 11, 13, 15))
_IAS15 = (1e-2, 1e-3, 1e-4, 1e-5, 1e-7, 1e-9)  # the order is 15: the error falls with more than the square of this
_WHFAST = [3 * 2**k for k in range(3, 12)]  # the longest is an eleventh of Jupiter's period
_DIFFRAX: dict[str, Any] = {"expressed": EXPRESSIONS, "most_degrees": 20, "cannot": without_events}

#: By name.
RIVALS = {
    "scipy dop853": Rival("SciPy DOP853", "scipy", partial(scipy, "DOP853")),
    "scipy rk45": Rival("SciPy RK45", "scipy", partial(scipy, "RK45")),
    "scipy lsoda": Rival("SciPy LSODA", "scipy", partial(scipy, "LSODA"), most_degrees=300),
    "heyoka": Rival("heyoka", "heyoka", heyoka, _HEYOKA, expressed=EXPRESSIONS),
    "cyrk dop853": Rival("CyRK DOP853", "CyRK", partial(cyrk, "DOP853")),
    "cyrk vern8": Rival("CyRK Vern8", "CyRK", partial(cyrk, "Vern8")),
    "diffrax tsit5": Rival("diffrax Tsit5", "diffrax", partial(diffrax, "Tsit5"), **_DIFFRAX),
    "diffrax dopri8": Rival("diffrax Dopri8", "diffrax", partial(diffrax, "Dopri8"), **_DIFFRAX),
    "rebound ias15": Rival("rebound IAS15", "rebound", ias15, _IAS15, expressed=DIMENSIONS),
    "rebound whfast": Rival("rebound WHFast", "rebound", whfast, substeps=_WHFAST, expressed=ORBITS),
    "verlet": Rival("Verlet by hand", "numba", verlet, substeps=[2**k for k in range(20)], cannot=without_velocity),
}
