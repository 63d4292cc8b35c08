"""eig3: explicit time integration of second-order systems u'' = f(t, u, u') in compiled code."""

import importlib
from typing import Any

from ._version import __version__
from .diagnosis.critical import CriticalStep, NoCriticalStepError, critical_step
from .ensembles.ensemble import ensemble
from .ensembles.solution import EnsembleSolution
from .functions.callbacks import jit
from .functions.events import Event
from .functions.extremes import Extremes
from .functions.named import Parameters
from .functions.sparse import Sparse
from .methods import (
    AB2,
    AB3,
    BM6,
    EIG,
    EIG3,
    METHODS,
    RK2,
    RK3,
    RK4,
    RK5,
    RK8,
    RKN12,
    CentralDifference,
    Langevin,
    Method,
)
from .planning.planner import Plan, plan
from .problem import Problem
from .result.error_estimate import ErrorEstimate
from .result.occurrences import Occurrences
from .result.solution import Solution, Status
from .run.chunks import IntegrationError
from .run.integration import integrate
from .run.loading import load
from .run.prepare import Prepared, prepare
from .stepping.stepper import Stepper

__all__ = [
    "AB2",
    "AB3",
    "BM6",
    "EIG",
    "EIG3",
    "METHODS",
    "RK2",
    "RK3",
    "RK4",
    "RK5",
    "RK8",
    "RKN12",
    "CentralDifference",
    "CriticalStep",
    "EnsembleSolution",
    "ErrorEstimate",
    "Event",
    "Extremes",
    "Fit",
    "IntegrationError",
    "Langevin",
    "Method",
    "Modal",
    "NoCriticalStepError",
    "Occurrences",
    "Parameters",
    "Plan",
    "Prepared",
    "Problem",
    "Rayleigh",
    "Sensitivities",
    "Solution",
    "Sparse",
    "Status",
    "Stepper",
    "__version__",
    "animation",
    "critical_step",
    "effects",
    "ensemble",
    "fit",
    "integrate",
    "jit",
    "linear",
    "load",
    "math",
    "noise",
    "plan",
    "prepare",
    "problems",
    "report",
    "scene",
    "sensitivities",
    "stability",
    "structures",
    "white_noise",
]


#: The modules of names that are imported on first access, so that `import eig3` stays fast; None for a module itself.
_LATER = {
    **dict.fromkeys(("animation", "effects", "math", "problems", "scene", "stability", "structures")),
    **dict.fromkeys(("noise", "white_noise"), "philox"),
    **dict.fromkeys(("Fit", "fit"), "fitting.fit"),
    **dict.fromkeys(("Sensitivities", "sensitivities"), "fitting.sensitivities"),
    **dict.fromkeys(("Modal", "Rayleigh", "linear"), "structures"),
    "report": "bench.report",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'eig3' has no attribute {name!r}")
    module = importlib.import_module(f"eig3.{_LATER[name] or name}")
    return getattr(module, name) if _LATER[name] else module


def __dir__() -> list[str]:
    return __all__
