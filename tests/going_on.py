"""Systems, and functions to follow, for runs that end and go on."""

import eig3

from .conftest import coupled, hardening, hardening_chain, oscillator

H = 2.0**-6  # exact in binary, so that every span has the same step

SCALAR = {"rhs": oscillator, "u0": 1.0, "v0": 0.0, "params": (2.0, 0.1)}
VECTOR = {"rhs": coupled, "u0": [1.0, 2.0, 3.0], "v0": [0.0, 1.0, 0.0], "params": (1.0, 2.0, 3.0)}
SCALAR_WITHOUT_V = {"rhs": hardening, "u0": 1.0, "v0": 0.0, "params": (2.0,)}
VECTOR_WITHOUT_V = {"rhs": hardening_chain, "u0": [1.0, 2.0, 3.0], "v0": [0.0] * 3, "params": (1.0, 2.0, 3.0)}

steady = eig3.jit(lambda t, u, v, p: t + 0.1 * u)


@eig3.jit
def forces(t, u, v, p, out):
    out[0], out[1] = u * t, v
