"""Responses of a structure: base shear, storey drifts, and the absolute motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from ..ensembles.solution import EnsembleSolution
from ..functions.callbacks import without_runtime
from ..functions.checks import reals, shown
from ..functions.layout import unknown_name
from ..problem import Problem
from . import source


def base_shear(problem: Problem) -> Any:
    """Return the base shear of a structure on moving ground, as an output for `Problem.integrate`.

    It is the sum of the elastic forces in the direction of the ground motion, r^T K u, and of the forces of links.

    Parameters
    ----------
    problem : Problem
        A problem of `eig3.linear` with a ground motion.

    Returns
    -------
    jitted function
        A function whose values are forces.

    Raises
    ------
    TypeError, ValueError
        If the problem has no ground motion.
    """
    _params(problem, "ground")
    return source.shear(parts_of(problem))


def link_forces(problem: Problem) -> tuple[Any, int]:
    """Return the tension of each link of a structure, as an output for `Problem.integrate`.

    Parameters
    ----------
    problem : Problem
        A problem of `eig3.linear` with links.

    Returns
    -------
    (jitted function, int)
        The function and its number of values: N, or N m for links of rotations. Links of one effect are together, in
        the order in which their effects come first in `links`. A link across two directions has two values.

    Raises
    ------
    TypeError, ValueError
        If the problem has no links.
    """
    return _of_links(problem, "pull")


def link_stretches(problem: Problem) -> tuple[Any, int]:
    """Return the stretch of each link of a structure, as an output for `Problem.integrate`.

    With `link_forces`, it gives the loops of links that yield. Once the
    structure is at rest, the last value is the residual stretch.

    Parameters
    ----------
    problem : Problem
        A problem of `eig3.linear` with links.

    Returns
    -------
    (jitted function, int)
        The function and its number of values: m, or rad for links of rotations, in the order of `link_forces`.

    Raises
    ------
    TypeError, ValueError
        If the problem has no links.
    """
    return _of_links(problem, "r")


def link_ductility(problem: Problem) -> tuple[Any, int]:
    """Return the ductility of each link of a structure that yields, as an output for `Problem.integrate`.

    It is the size of the stretch divided by the stretch at yield. ``solution.extremes["ductility"].peak`` is the
    ductility demand of a run, and ``members.summary()`` has it as "peak of ductility[0]".

    Parameters
    ----------
    problem : Problem
        A problem of `eig3.linear` with links.

    Returns
    -------
    (jitted function, int)
        The function and its number of values, in the order of `link_forces` without the links that do not yield, such
        as `Maxwell`. A link across two directions has one value.

    Raises
    ------
    TypeError, ValueError
        If the problem has no links that yield.
    """
    function, count = _of_links(problem, "ductility", len)
    if not count:
        raise ValueError("problem must have links that yield, such as ElasticPlastic.")
    return function, count


def _of_links(problem: Problem, what: str, values: Callable[[Any], int] = np.size) -> tuple[Any, int]:
    """Return the output of the links that have a value, and the number of values, by the ends of each kind."""
    p, parts = _params(problem, "states"), parts_of(problem)
    having = (k for k, kind in enumerate(parts.links) if what != "ductility" or what in kind.names)
    return source.of_links(parts, what), sum(values(p[f"link_{k}_first"]) for k in having)


def parts_of(problem: Problem) -> source.Parts:
    """Return the parts of a structure."""
    return problem.rhs.py_func.inner.py_func.parts


def storey_drifts(problem: Problem, floors: Sequence[int | str]) -> tuple[Any, int]:
    """Return the drifts of storeys, as an output for `Problem.integrate`.

    Parameters
    ----------
    problem : Problem
    floors : sequence of int or str
        The degree of freedom of each floor, from the lowest floor on, by number or name. The drift of the first storey
        is relative to the ground.

    Returns
    -------
    (jitted function, int)
        The function and its number of values, which have the unit of the displacements. The last values of a run that
        has come to rest are the residual drifts.

    Raises
    ------
    TypeError, ValueError
        If a floor is not known.
    """
    places = tuple(_place(problem, floor) for floor in floors)
    if not places:
        raise ValueError("floors must name at least one degree of freedom.")

    @without_runtime
    def drifts(t, u, v, p, out):  # type: ignore[no-untyped-def]
        below = 0.0
        for k in range(len(places)):
            out[k] = u[places[k]] - below
            below = u[places[k]]

    return drifts, len(places)


def ground_motion(problem: Problem, t: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the displacement, velocity and acceleration of the ground, which is at rest before its record.

    Velocity and displacement are integrals of the acceleration, which is linear between the times of the record and
    zero outside.

    Parameters
    ----------
    problem : Problem
        One of `eig3.linear` with a ground motion.
    t : array_like

    Returns
    -------
    displacement, velocity, acceleration : ndarray
        They have the shape of t.

    Raises
    ------
    TypeError, ValueError
        If the problem has no ground motion, or t is not made of numbers.
    """
    return _ground(_params(problem, "ground"), reals(t, "t"))


def absolute_motion(problem: Problem, solution: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the absolute motion of a run: u, v and a, with the motion of the ground added.

    Parameters
    ----------
    problem : Problem
        One of `eig3.linear` with a ground motion.
    solution : Solution or EnsembleSolution
        A run of the problem, a member of an ensemble, or a whole ensemble. The ground motion comes from the parameters
        of the run; a copied `Solution` has no parameters, and gets the ground motion of the problem.

    Returns
    -------
    u, v, a : ndarray, shape (s, n)
        With a first axis of members for an ensemble, and NaN after the end of a member.

    Raises
    ------
    TypeError, ValueError
        If the problem has no ground motion, or the solution no accelerations.
    """
    known, accelerations = _params(problem, "ground"), solution.a
    if accelerations is None:
        raise ValueError(
            "solution must have its right-hand side, for the accelerations: take the solution that the run "
            "returned, not a copy, or load it with problem.load(path)."
        )
    relative = solution.u, solution.v, accelerations
    read = known.layout.read
    if isinstance(solution, EnsembleSolution):
        all_params = np.broadcast_to(solution.params, (len(solution), solution.params.shape[-1]))
        each = zip(all_params, solution.t, *relative, strict=True)
        u, v, a = (np.array(x) for x in zip(*(_absolute(read(p), *rows) for p, *rows in each), strict=True))
        return u, v, a
    return _absolute(known if solution._params is None else read(solution._params), solution.t, *relative)


def _absolute(p: Any, t: np.ndarray, *relative: np.ndarray) -> Any:
    """Add the motion of the ground with the parameters p to u, v and a, shape (s, n)."""
    return tuple(x + np.outer(g, p.influence) for x, g in zip(relative, _ground(p, t), strict=True))


def _ground(p: Any, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the displacement, velocity and acceleration of the ground with the parameters p."""
    record = make_interp_spline(p.ground_times, p.ground_scale * p.ground, k=1)
    inside = np.clip(t, p.ground_times[0], p.ground_times[-1])
    velocity = record.antiderivative(1)(inside)
    displacement = record.antiderivative(2)(inside) + velocity * (t - inside)
    return displacement, velocity, np.where(t == inside, record(inside), 0.0)


def _params(problem: Any, name: str) -> Any:
    """Return the parameters of a problem, which must have this name."""
    known = getattr(getattr(getattr(problem, "params", None), "layout", None), "names", ())
    if not isinstance(problem, Problem) or "size" not in known:
        raise TypeError(f"problem must be a problem of eig3.linear, not {shown(problem)}.")
    if name not in known:
        what = "links" if name == "states" else name
        raise ValueError(f"problem must have {what}: give it to eig3.linear.")
    return problem.params


def _place(problem: Problem, floor: Any) -> int:
    """Return the number of a degree of freedom."""
    n = np.size(problem.u0)
    if isinstance(floor, str) and problem.names:
        if floor not in problem.names:
            raise unknown_name("the problem has", floor, problem.names, ValueError)
        return list(problem.names).index(floor)
    if not isinstance(floor, int | np.integer) or isinstance(floor, bool) or not 0 <= floor < n:
        raise ValueError(f"floors must be numbers from 0 to {n - 1}, or names, not {shown(floor)}.")
    return int(floor)
