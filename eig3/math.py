"""Elementary functions for right-hand sides, without branches or calls: the compiler vectorises loops over them.

``math.sin`` and similar functions call the C library once for each number, also inside a loop over many members. The
functions here use only arithmetic: LLVM computes several numbers with each instruction. They work in every function
compiled by Numba, and can be called from Python.
"""

from .kernels.elementary import cos, erfc, exp, log, sin, sincos, sqrt, tanh

__all__ = ["cos", "erfc", "exp", "log", "sin", "sincos", "sqrt", "tanh"]
