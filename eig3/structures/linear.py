"""`linear`: a structure given by its matrices."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_arguments
from ..functions.checks import check_count, check_span, reals, shown
from ..functions.named import Parameters
from ..kernels.compile.numba_internals import Jitted
from ..keywords import with_suggestions
from .damping import Modal, Rayleigh
from .factors import copies_in, factors
from .links import check_links, events_of, states_of
from .loads import check_ground, check_table, checksum, sources
from .matrices import Mass, check_mass, check_matrix, check_symmetric, edge_of_blocks, is_gyroscopic
from .modal import exact_motion, unknown
from .source import INTEGRALS, LOADED, Parts, energy, of_events, right_hand_side
from .structure import Structure

_LINKS = "the structure has links: leave them out"
_FORCE = "f(t, u, v, p, out), which adds to out"
_CIRCULATORY = "; add its antisymmetric part by force=f, a jitted function f(t, u, v, p, out)"
_FUNCTION = "the force is a function: give it as a table if it depends on the time only"


@with_suggestions()
def linear(
    M: Any,
    C: Any = None,
    K: Any = None,
    *,
    force: Any = None,
    ground: Any = None,
    damping: Rayleigh | Modal | None = None,
    links: Sequence[tuple[Any, Any, Any]] = (),
    t_span: Sequence[float],
    u0: ArrayLike = 0.0,
    v0: ArrayLike = 0.0,
    lump: str | None = None,
    names: Sequence[str] = (),
    units: str | Sequence[str] = "m",
    work: bool = False,
    threads: int = 1,
    params: Any = None,
) -> Structure:
    """Return the problem M u'' + C u' + K u = f of a structure given by its matrices.

    Parameters
    ----------
    M : array_like, shape (n,) or (n, n), or sparse
        The masses, or a symmetric matrix. A matrix that is not diagonal is factorised once and solved in each
        evaluation.
    C, K : array_like, shape (n, n), or sparse
        Damping and stiffness. K must be symmetric; C may have a gyroscopic part.
    force : jitted function, or tuple
        ``f(t, u, v, p, out)`` adds forces to out. A table (times, forces) or (times, forces, degrees), whose forces
        have the shape (times, degrees), is linear between its times and zero outside. With tolerances, steps are at
        most half as long as the shortest load of a record, so that none jumps over it; ``h_max`` replaces this limit. A
        run whose fixed step skips much of a record has a note.
    ground : tuple
        The ground motion (times, accelerations) or (times, accelerations, influence): u is then relative to the ground.
        The acceleration is linear between the times and zero outside. The influence is 1 for a degree of freedom in the
        direction of the motion, and 0 for a perpendicular one; a number is for all, by default 1.
    damping : Rayleigh or Modal
        Damping in addition to C.
    links : sequence of (Link, first, second)
        Links of `eig3.effects` between two degrees of freedom, such as ``(BoucWen(2e6, 0.01), 0, 1)``. The ends are
        numbers or names, sequences of these, or None for the ground. The stretch r is u of the second end minus u of
        the first. The ends of a link across two directions, such as `FrictionPendulum`, are pairs of these.
        ``z["bouc wen"]`` has the states of links with memory.
    t_span : (float, float)
    u0, v0 : float or array_like, shape (n,)
    lump : {"row", "hrz"}, optional
        Make M diagonal: by its row sums, or by its scaled diagonal, whose masses are always positive. Both are for
        matrices of displacements alone, and not for rotations, such as the ones of beams.
    names, units : sequence of str
        The names and units of the degrees of freedom.
    work : bool
        Integrate the work of forces, ground, damping and links, ``z["work"]``, the energy that the damping has
        dissipated, ``z["dissipated"]``, and the energy that links have stored or dissipated, ``z["absorbed"]``. The
        energy minus the work is then an invariant.
    threads : int
        The number of threads that share the rows, with bitwise the same results. Threads pay from about 10^4 degrees of
        freedom on. Each member of an ensemble has one thread.
    params : NamedTuple or dict
        Parameters that `force` reads, such as ``p.gap``.

    Returns
    -------
    Structure
        A Problem with a method `modes`. Its `params` are M, C, K and the others by name. Its energy is the kinetic plus
        the elastic energy; with loads or damping it has one only with `work`. Its exact motion is known without C and
        without a function `force`, for at most 1000 degrees of freedom. Otherwise `exact` is false in a condition, and
        a call raises an error with the reason.

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid.
    """
    mass = check_mass(M, lump)
    n = mass.n
    check_count(threads, "threads")
    has = {"lumped" if mass.diagonal is not None else "consistent"} | ({"work"} if work else set())
    matrices = {name: check_matrix(A, name, n) for name, A in (("K", K), ("C", C)) if A is not None}
    if K is not None:
        check_symmetric(matrices["K"], "K", _CIRCULATORY)
    edge = edge_of_blocks(matrices.values())
    blocks = {name: matrix.tobsr((edge, edge)) if edge > 1 else matrix for name, matrix in matrices.items()}
    copies, of_mass = _of_mass(mass)
    u0 = _start(u0, "u0", n)
    kinds, of_links = check_links(links, names, n, u0)
    values = {"size": n} | of_links | of_mass | blocks  # events read the links, whose places are found faster if first
    has |= set(matrices)
    if damping is not None:
        values |= _of_damping(damping, mass, matrices.get("K"))
        has.add("rayleigh" if isinstance(damping, Rayleigh) else "modal")
    if ground is not None:
        values |= check_ground(ground, n)
        has.add("ground")
    if force is not None:
        is_function = isinstance(force, Jitted)
        if is_function:
            check_arguments(force.py_func, "force", _FORCE, 5)
        else:
            values |= check_table(force, n)
        has.add("force" if is_function else "table")
    has |= {"links"} if kinds else set()
    if sources(values):
        values["checksum"] = checksum(Parameters(values)._asdict())
    own = {} if params is None else Parameters(params)._asdict()
    taken = sorted({*own} & {*values})
    if taken:
        raise ValueError(f"params must not have the name {taken[0]}, which the structure has already.")
    parts = Parts(frozenset(has), edge, copies, threads, kinds)
    v0, t_span = _start(v0, "v0", n), check_span(t_span)
    every = Parameters(values | own)
    changing = has & LOADED - ({"C"} if "C" in has and is_gyroscopic(matrices["C"]) else set())
    why = _FUNCTION if "force" in has else _LINKS if links else ""
    return Structure(
        name="structure",
        rhs=right_hand_side(parts, force if "force" in has else None),
        u0=u0,
        v0=v0,
        params=every,
        t_span=t_span,
        exact=unknown(why) if why else exact_motion(every, u0, v0, t_span[0]),
        energy=energy(parts) if work or not changing else None,
        names=_names(names, n),
        units=units if isinstance(units, str) else tuple(units),
        z0=states_of(kinds, values) | (dict.fromkeys(INTEGRALS[: 3 if kinds else 2], 0.0) if work else {}),
        events=events_of(kinds, values, every.layout, partial(of_events, parts)),
    )


def _of_mass(mass: Mass) -> tuple[int, dict[str, Any]]:
    """Return the number of copies in a mass, and its parameters, including the matrix for the energy."""
    if mass.diagonal is not None:
        return 1, {"m": mass.diagonal}
    copies = copies_in(mass.matrix)
    return copies, factors(mass.matrix[::copies][:, ::copies])._asdict() | {"M": mass.matrix}


def _of_damping(damping: Any, mass: Mass, K: Any) -> dict[str, Any]:
    """Return the parameters of the damping."""
    if not isinstance(damping, Rayleigh | Modal):
        raise TypeError(f"damping must be eig3.Rayleigh(...) or eig3.Modal(...), not {shown(damping)}.")
    if K is None:
        raise ValueError(
            "damping needs K, without the links: if links have all of the stiffness, give C = a M + b K of the elastic "
            "structure in place of damping."
        )
    names = ("a", "b") if isinstance(damping, Rayleigh) else ("modes", "rates")
    found: Any = damping.of(mass, K).coefficients if isinstance(damping, Rayleigh) else damping.factors(mass, K)
    return dict(zip(names, found, strict=True))


def _names(names: Any, n: int) -> tuple[str, ...]:
    given = tuple(names)
    if given and not (len(given) == len({*given}) == n and all(isinstance(name, str) for name in given)):
        raise ValueError(f"names must be {n} different texts, one for each degree of freedom.")
    return given


def _start(x: Any, name: str, n: int) -> np.ndarray:
    start = reals(x, name)
    if start.shape not in ((), (n,)) or not np.isfinite(start).all():
        raise ValueError(f"{name} must be a finite number, or {n} of them, not of the shape {start.shape}.")
    return np.array(np.broadcast_to(start, n))
