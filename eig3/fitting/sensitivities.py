"""`sensitivities`: derivatives of a run with respect to parameters and initial values."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..ensembles.solution import EnsembleSolution
from ..functions.checks import check_flag, check_h, reals
from ..functions.layout import unknown_name
from ..kernels.compile.interrupt import with_solution
from ..keywords import with_suggestions
from ..methods import Method
from ..problem import Problem
from ..run.chunks import IntegrationError
from .places import Place, check_places, said, sizes, varied
from .series import History
from .stencils import differences, usual_steps


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities:
    """A run and its derivatives with respect to p parameters.

    ``result["k"]`` is the `History` of the derivatives with respect to k, such as ``result["k"].u``.

    Attributes
    ----------
    values : dict of str to float
        The parameters by name, in the order in which they were given.
    t : ndarray, shape (s,)
    states : History
        The run itself.
    derivatives, errors : History
        Derivatives with respect to each parameter, and estimates of the errors of the differences, with a first axis of
        parameters. The derivatives belong to the computed run, whose time-step error comes in addition.
    steps : dict of str to float
        The steps of the differences.
    step_errors : History or None
        Estimates of the time-step errors of the derivatives, if `check` is True.
    notes : tuple of str
        The notes of the run, as in `Solution.notes`, and of the ensemble.
    """

    values: dict[str, float]
    t: np.ndarray
    states: History
    derivatives: History
    errors: History
    steps: dict[str, float]
    step_errors: History | None = None
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> History:
        if name not in self.values:
            raise unknown_name("the sensitivities have", str(name), [*self.values], KeyError)
        return self.derivatives[[*self.values].index(name)]

    def __repr__(self) -> str:
        lines = [f"Sensitivities at {len(self.t)} times:"]
        for i, (name, value) in enumerate(self.values.items()):
            most, error = (np.abs(x.u[i]).max(initial=0.0) for x in (self.derivatives, self.errors))
            line = f"  {name} = {value:.6g}: |du/d{name}| is at most {most:.4g}; error of differences {error:.1g}"
            if self.step_errors:
                line += f", of the steps {np.abs(self.step_errors.u[i]).max(initial=0.0):.1g}"
            lines.append(line)
        if not self.step_errors:
            lines.append("  The error of the steps is not in these: check=True estimates it.")
        return "\n".join([*lines, *(f"  Note: {note}" for note in self.notes)])


@with_solution
@with_suggestions()
def sensitivities(
    problem: Problem,
    parameters: str | Iterable[str],
    *,
    h: float,
    method: str | Method = "eig3",
    t_end: float | None = None,
    save_every: int | None = 1,
    t_eval: ArrayLike | None = None,
    outputs: Mapping[str, Any] | None = None,
    steps: Mapping[str, float] | None = None,
    check: bool = False,
) -> Sensitivities:
    """Find the derivatives of a run with respect to parameters and initial values, from runs in SIMD lanes.

    For each parameter p, four members of an ensemble have the values p - 2 d, p - d, p + d and p + 2 d. All members
    take the same steps h, so the computed states are smooth functions of p if rhs is smooth. Central differences D(d)
    and D(2 d) give the derivative (4 D(d) - D(2 d)) / 3 of the order 4, by Richardson extrapolation.

    Parameters
    ----------
    problem : Problem
        Its first-order unknowns have derivatives too.
    parameters : str or sequence of str
        Names of parameters: "k", an entry "k[2]" of an array, "p[3]" if the parameters have no names; and entries
        "u0[1]" and "v0[0]" of the initial values, or "u0" and "v0" with one degree of freedom.
    h, method, t_end, save_every, t_eval, outputs
        As for `Problem.integrate`.
    steps : dict of str to float
        Steps d by name, rounded down to powers of two. By default d is 2^-12 of the size of the value. For a value of
        zero, this is the size of the largest entry of its named array, for an initial value the size of the motion, and
        otherwise 1.
    check : bool
        Estimate the time-step errors of the derivatives from their change with half the step, by Richardson
        extrapolation with the order of the method. This takes three times as long.

    Returns
    -------
    Sensitivities

    Raises
    ------
    TypeError, ValueError
        An argument is not valid.
    IntegrationError
        A member diverged.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` is the interrupted run or ensemble; None between two runs.
    """
    places = check_places(problem, parameters)
    own = _check_steps(places, steps)
    options: dict[str, Any] = {"method": method, "t_end": t_end, "outputs": outputs, "t_eval": t_eval}
    is_checked, every = check_flag(check, "check"), save_every if t_eval is None else None
    h = check_h(h)

    def run(rows: np.ndarray, h: float, every: int | None) -> EnsembleSolution:
        """Run members with these values, shape (m, p)."""
        given = varied(problem, places, rows)
        members = problem.ensemble(**given, invariants={}, h=h, save_every=every, **options)
        _check_members(members, places, rows)
        return members

    values = np.array([place.value(problem) for place in places])
    usual = usual_steps(sizes(problem, places, lambda: run(values[None], h, every)[0]))
    lengths = [own.get(place.name, step) for place, step in zip(places, usual, strict=True)]
    chosen = differences(values, np.array(lengths))
    members = run(chosen.rows, h, every)
    found, step_errors = _history(members), None
    single = problem.integrate(h=h, method=method, t_end=t_end, save_every=None, invariants={})
    if is_checked:
        finer = run(chosen.rows, members[0].h / 2, every and 2 * every)
        change = chosen.derivatives(_history(finer).less(found))
        step_errors = change.map(lambda x: np.abs(x) / (1 - 0.5**members.method.order))
    names = [place.name for place in places]
    return Sensitivities(
        dict(zip(names, values.tolist(), strict=True)),
        np.array(members.t[0]),
        found[0],
        chosen.derivatives(found),
        chosen.errors(found, int(members.n_steps[0])),
        dict(zip(names, chosen.steps.tolist(), strict=True)),
        step_errors,
        (*dict.fromkeys((*single.notes, *members.notes)),),
    )


def _check_steps(places: Sequence[Place], steps: Mapping[str, float] | None) -> dict[str, float]:
    """Return the steps of the differences that the user gives, by name."""
    names = [place.name for place in places]
    for name, step in (steps or {}).items():
        if name not in names:
            raise unknown_name("steps must have names of parameters, which have", name, names, ValueError)
        size = reals(step, f"steps[{name!r}]")
        if size.ndim or not 0 < size < np.inf:
            raise ValueError(f"steps[{name!r}] must be a positive, finite number, not {step!r}.")
    return {name: float(step) for name, step in (steps or {}).items()}


def _check_members(members: EnsembleSolution, places: Sequence[Place], rows: np.ndarray) -> None:
    """Raise an error that names the values of the first member that did not complete, or has no finite output."""
    failed = np.flatnonzero(~members.success)
    if failed.size:
        i = int(failed[0])
        member = members[i]
        message = f"The run with {said(places, rows[i])} fails: {member.explain()}"
        raise IntegrationError(dataclasses.replace(member, message=message))
    for name, values in members.outputs.items():
        bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
        if bad.size:
            raise ValueError(f"outputs[{name!r}] must be finite, but is not with {said(places, rows[bad[0]])}.")


def _history(members: EnsembleSolution) -> History:
    return History(members.u, members.v, members.outputs, members.z)
