"""The errors of the members of an ensemble, from the same ensemble with other steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..result.error_estimate import Companion, ErrorEstimate, estimate
from ..result.solution import Solution
from ..run.chunks import check_repeatable
from ..run.variable_run import companion_ratios, companion_tolerances
from ..stepping.march import Cancel
from ..stepping.run_options import RunOptions
from .in_process import Run
from .members import Members
from .solution import EnsembleSolution


class MemberErrors:
    """The estimated errors of the m members of an ensemble; ``errors[i]`` has the errors of member i.

    They are computed when they are read.

    Attributes
    ----------
    largest : dict of str to ndarray, shape (m,)
        The largest absolute error of u, v, and each output, first-order unknown, invariant and event time, by name.
    order : ndarray, shape (m,)
        The order that each member shows; NaN if it is not known.
    reliable_until : ndarray, shape (m,)
        The time after which no digit of u is right; NaN if there is no such time.
    """

    def __init__(self, solution: EnsembleSolution, others: Sequence[tuple[EnsembleSolution, float]]) -> None:
        self._solution = solution
        self._others = others  # the finer and, if it can be compared, the coarser ensemble, with their ratios

    def __len__(self) -> int:
        return len(self._solution)

    def __iter__(self) -> Iterator[ErrorEstimate | None]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> ErrorEstimate | None:
        """Return the errors of a member; None if it failed."""
        member = self._solution[i]
        if not member.success:
            return None
        fine, *coarse = (_companion(member, other[i], ratio) for other, ratio in self._others)
        return estimate(member, fine, coarse[0] if coarse else None)

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
    others: list[tuple[Members, RunOptions, float]]
    if options.tolerances:
        ratios = companion_ratios(options.tolerances)
        others = [(members, _with_tolerances(options, ratio), ratio) for ratio in ratios]
    else:
        tried = (_with_steps(members, options, steps) for steps in (_finer(members, options), 1))
        others = [other for other in tried if other]
    found = [(Run(rhs, some, own, threads).march(cancel=cancel), ratio) for some, own, ratio in others]
    return MemberErrors(solution, found)


def check_members_repeatable(options: RunOptions, what: str, **given: Any) -> None:
    """Refuse an ensemble that cannot be repeated here; `what` is the argument that needs this."""
    check_repeatable(options.method)
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{what} and {name} exclude each other: {what} compares the states of the whole ensemble.")


def _finer(members: Members, options: RunOptions) -> int:
    """Return the number of steps in place of two: three if all members can be compared, otherwise four."""
    is_even = bool((members.n_steps % 2 == 0).all()) and (options.save_every is None or options.save_every % 2 == 0)
    return 3 if is_even or options.t_eval is not None else 4


def _with_steps(members: Members, options: RunOptions, steps: int) -> tuple[Members, RunOptions, float] | None:
    """Return the members with `steps` steps in place of two; None if their states are at other times."""
    n_steps = np.maximum(1, members.n_steps * steps // 2)
    h = (members.t_span[1] - members.t_span[0]) / n_steps
    every = options.save_every
    if every is not None:
        if steps == 1 and (members.n_steps % 2).any():
            return None
        every = every * steps // 2 if every * steps % 2 == 0 else every * steps
    h = h if members.has_own_step else float(h[0])
    options = options._replace(h=float(np.ravel(h)[0]), save_every=every)
    return replace(members, h=h, n_steps=n_steps), options, 2 / steps


def _with_tolerances(options: RunOptions, ratio: float) -> RunOptions:
    assert options.tolerances
    tolerances = companion_tolerances(options.tolerances, ratio)
    every = None if options.save_every is None else 1
    return options._replace(tolerances=tolerances, save_every=every)


def _companion(member: Solution, other: Solution, ratio: float) -> Companion:
    if member.steps is None:
        return Companion.at_same_steps(member, other, other.h / member.h)
    return Companion.between_steps(member, other, ratio)
