"""`linear`: a structure by its matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_span, reals, shown
from ..kernels.compile.numba_internals import Jitted
from ..problem import Problem
from .damping import Modal, Rayleigh
from .loads import check_ground, check_table
from .matrices import Mass, check_mass, check_matrix, check_symmetric, factors
from .source import LOADED, energy, right_hand_side


def linear(
    M: Any,
    C: Any = None,
    K: Any = None,
    *,
    force: Any = None,
    ground: Any = None,
    damping: Rayleigh | Modal | None = None,
    t_span: Sequence[float],
    u0: ArrayLike = 0.0,
    v0: ArrayLike = 0.0,
    lump: str | None = None,
    names: Sequence[str] = (),
    units: str | Sequence[str] = "m",
    work: bool = False,
) -> Problem:
    """Return the problem M u'' + C u' + K u = f of a structure that is given by its matrices.

    Parameters
    ----------
    M : array_like, shape (n,) or (n, n), or sparse
        The masses, or a symmetric matrix. One that is not diagonal is solved in each evaluation, from factors that are
        computed once.
    C, K : array_like, shape (n, n), or sparse
        Damping and stiffness. K must be symmetric; C may have a gyroscopic part.
    force : jitted function, or tuple
        ``f(t, u, v, p, out)`` adds forces to out. A table (times, forces) or (times, forces, degrees), whose forces
        have the shape (times, degrees), is linear between its times and zero outside.
    ground : tuple
        The ground's motion (times, accelerations) or (times, accelerations, influence): u is then relative to it. The
        acceleration is linear between the times and zero outside. The influence is 1 for a degree of freedom in the
        direction of the motion, and 0 across it; without it, all are 1.
    damping : Rayleigh or Modal
        In addition to C.
    t_span : (float, float)
    u0, v0 : float or array_like, shape (n,)
    lump : {"row", "hrz"}, optional
        Make M diagonal: by its row sums, or by its scaled diagonal, whose masses are always positive.
    names, units : sequence of str
        Those of the degrees of freedom.
    work : bool
        Let runs follow the work of forces, ground and damping, so that the energy less the work is an invariant.

    Returns
    -------
    Problem
        Its `params` are M, C, K and the others by name. Its energy is the kinetic and the elastic one.

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid.
    """
    mass = check_mass(M, lump)
    n = mass.n
    params, has = _of_mass(mass, work), {"work"} if work else set()
    if mass.diagonal is None:
        has.add("consistent")
    for name, matrix in (("K", K), ("C", C)):
        if matrix is not None:
            params[name] = check_matrix(matrix, name, n)
            has.add(name)
    if K is not None:
        check_symmetric(params["K"], "K")
    if damping is not None:
        params |= _of_damping(damping, mass, params.get("K"))
        has.add("rayleigh" if isinstance(damping, Rayleigh) else "modal")
    if ground is not None:
        params |= check_ground(ground, n)
        has.add("ground")
    if force is not None:
        is_function = isinstance(force, Jitted)
        params |= {} if is_function else check_table(force, n)
        has.add("force" if is_function else "table")
    parts = frozenset(has)
    return Problem(
        name="structure",
        rhs=right_hand_side(parts, force if "force" in has else None),
        u0=_start(u0, "u0", n),
        v0=_start(v0, "v0", n),
        params=params,
        t_span=check_span(t_span),
        energy=energy(parts) if work or not has & LOADED else None,
        names=tuple(names),
        units=units if isinstance(units, str) else tuple(units),
        integrals=("work",) if work else (),
    )


def _of_mass(mass: Mass, work: bool) -> dict[str, Any]:
    """Return the parameters of the mass: the matrix itself is needed for its energy, and for the work."""
    params: dict[str, Any] = {"size": mass.n}
    if mass.diagonal is not None:
        return params | {"m": mass.diagonal} | ({"M": mass.matrix} if work else {})
    params["order"], params["L"], params["U"], params["inverse"] = factors(mass.matrix)
    return params | {"M": mass.matrix}


def _of_damping(damping: Any, mass: Mass, K: Any) -> dict[str, Any]:
    """Return the parameters of a damping."""
    if not isinstance(damping, Rayleigh | Modal):
        raise TypeError(f"damping must be eig3.Rayleigh(...) or eig3.Modal(...), not {shown(damping)}.")
    if K is None:
        raise ValueError("damping needs K: the frequencies of the structure depend on it.")
    names = ("a", "b") if isinstance(damping, Rayleigh) else ("modes", "rates")
    values: Any = damping.coefficients if isinstance(damping, Rayleigh) else damping.factors(mass, K)
    return dict(zip(names, values, strict=True))


def _start(x: Any, name: str, n: int) -> np.ndarray:
    start = reals(x, name)
    if start.shape not in ((), (n,)) or not np.isfinite(start).all():
        raise ValueError(f"{name} must be a finite number, or {n} of them, not of the shape {start.shape}.")
    return np.array(np.broadcast_to(start, n))
