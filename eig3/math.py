"""Functions for right-hand sides: elementary functions, and interpolation in tables.

``math.sin`` and similar functions call the C library once for each number, also inside a loop over many members. The
elementary functions here have no branches and no calls, so that LLVM computes several numbers with each instruction.
All functions work in every function compiled by Numba, and can be called from Python.
"""

from .kernels.elementary import cos, erfc, exp, log, sin, sincos, sqrt, tanh
from .kernels.table import interp

__all__ = ["cos", "erfc", "exp", "interp", "log", "sin", "sincos", "sqrt", "tanh"]
