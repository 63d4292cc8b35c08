"""The errors of the members of an ensemble, from the same ensemble with other steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..result.error_estimate import Companion, ErrorEstimate, estimate
from ..run.run import check_repeatable
from ..run.variable_run import companion_tolerances
from ..stepping.march import Cancel
from ..stepping.options import RunOptions
from ..stepping.tolerances import LEAST_RTOL
from .in_process import Run
from .members import Members
from .solution import EnsembleSolution

_RATIO = 10  # of the tolerances


class MemberErrors:
    """The estimated errors of the m members of an ensemble; ``errors[i]`` has the errors of member i.

    They are computed when they are read.

    Attributes
    ----------
    largest : dict of str to ndarray, shape (m,)
        The largest absolute error of u, v, and each output, quadrature, invariant and event time, by name.
    order : ndarray, shape (m,)
        The order that each member shows; NaN if it is not known.
    reliable_until : ndarray, shape (m,)
        The time after which no digit of u is right; NaN if there is no such time.
    """

    def __init__(self, solution: EnsembleSolution, fine: EnsembleSolution, coarse: EnsembleSolution | None) -> None:
        self._solution, self._fine, self._coarse = solution, fine, coarse

    def __len__(self) -> int:
        return len(self._solution)

    def __iter__(self) -> Iterator[ErrorEstimate | None]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> ErrorEstimate | None:
        """Return the errors of a member; None if it failed."""
        member = self._solution[i]
        if not member.success:
            return None
        is_fixed = member.steps is None
        fine = _companion(member, self._fine[i], is_fixed)
        coarse = None if self._coarse is None else _companion(member, self._coarse[i], is_fixed)
        return estimate(member, fine, coarse, member.method.order if is_fixed else None)

    @cached_property
    def _all(self) -> list[ErrorEstimate | None]:
        return list(self)

    @property
    def largest(self) -> dict[str, np.ndarray]:
        found = [{} if error is None else error.largest for error in self._all]
        names = dict.fromkeys(name for each in found for name in each)
        return {name: np.array([each.get(name, np.nan) for each in found]) for name in names}

    @property
    def order(self) -> np.ndarray:
        return self._numbers("order")

    @property
    def reliable_until(self) -> np.ndarray:
        return self._numbers("reliable_until")

    def _numbers(self, name: str) -> np.ndarray:
        values = [None if error is None else getattr(error, name) for error in self._all]
        return np.array([np.nan if x is None else x for x in values])

    def __repr__(self) -> str:
        errors = self.largest.get("u", np.empty(0))
        return f"error of u at most {np.nanmax(errors, initial=0.0):.2g} in {np.isfinite(errors).sum()} members"


def errors_of_members(
    rhs: Any, members: Members, options: RunOptions, threads: int, solution: EnsembleSolution, cancel: Cancel | None
) -> MemberErrors:
    """Run the ensemble with finer and with coarser steps."""
    others: list[tuple[Members, RunOptions] | None]
    if options.has_tolerances:
        assert options.tolerances
        has_finer = options.tolerances.rtol >= _RATIO * LEAST_RTOL
        ratios = (1 / _RATIO, _RATIO) if has_finer else (_RATIO,)
        others = [*((members, _with_tolerances(options, ratio)) for ratio in ratios), None][:2]
    else:
        others = [_with_steps(members, options, steps) for steps in (_finer(members, options), 1)]
    fine, coarse = (None if other is None else Run(rhs, *other, threads).march(cancel=cancel) for other in others)
    assert fine
    return MemberErrors(solution, fine, coarse)


def check_members_repeatable(options: RunOptions, **given: Any) -> None:
    """Refuse an ensemble that cannot be repeated here."""
    check_repeatable(options.method)
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"check and {name} exclude each other: check compares the states of the whole ensemble.")


def _finer(members: Members, options: RunOptions) -> int:
    """Return the number of steps in place of two: three if all members can be compared, otherwise four."""
    is_even = bool((members.n_steps % 2 == 0).all()) and (options.save_every is None or options.save_every % 2 == 0)
    return 3 if is_even or options.t_eval is not None else 4


def _with_steps(members: Members, options: RunOptions, steps: int) -> tuple[Members, RunOptions] | None:
    """Return the members with `steps` steps in place of two; None if their states are at other times."""
    n_steps = np.maximum(1, members.n_steps * steps // 2)
    h = (members.t_span[1] - members.t_span[0]) / n_steps
    every = options.save_every
    if every is not None:
        if steps == 1 and (members.n_steps % 2).any():
            return None
        every = every * steps // 2 if every * steps % 2 == 0 else every * steps
    h = h if members.has_own_step else float(h[0])
    return replace(members, h=h, n_steps=n_steps), options._replace(h=float(np.ravel(h)[0]), save_every=every)


def _with_tolerances(options: RunOptions, ratio: float) -> RunOptions:
    assert options.tolerances
    tolerances = companion_tolerances(options.tolerances, ratio)
    every = None if options.save_every is None else 1
    return options._replace(tolerances=tolerances, save_every=every)


def _companion(member: Any, other: Any, is_fixed: bool) -> Companion:
    if is_fixed:
        return Companion.at_same_steps(member, other, other.h / member.h, "a run with other steps")
    return Companion.between_steps(member, other, 1 / _RATIO, "a run with other tolerances")
