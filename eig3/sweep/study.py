"""Run the members of a parameter study in batches, and compute their measures."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..functions.checks import check_h, check_method, check_time
from ..functions.companions import history_of
from ..functions.named import has_names
from ..methods import Method, shown
from ..planning.suggested_step import first_step
from ..problem import Problem
from ..result.memory import check_study
from ..result.solution import Status
from ..run.progress import Progress
from .axes import MOST_WHOLE, Axis
from .measures import Measure
from .parameters import Parameters

_BATCH_VALUES = 2**23  # largest number of parameters and states in a batch: 64 MB
_LEAST_BATCH, _BATCHES = 256, 20  # a batch fills the lanes of some cores; the progress bar advances after each batch


@dataclass(eq=False)
class Study:
    """A parameter study and its results.

    Attributes
    ----------
    problem : Problem
        The problem of a member, for its name, units and span.
    parameters : Parameters
    axes : list of Axis
    columns : dict of str to ndarray, shape (m,)
        The values of the swept parameters.
    fixed : dict of str to float
        The parameters that differ from the defaults of the problem in all members.
    measures : list of Measure
    values : dict of str to ndarray, shape (m,)
        The measures by name; NaN for members that did not reach the end.
    errors : dict of str to ndarray, shape (m,)
        The errors of the measures by name, after `check`; until then empty.
    status : ndarray of Status, shape (m,)
    h : float
    method : Method
    after : float or None
        Time after which the members are measured; the start if None.
    seed : int or None
        The seed of a random sample; None for a grid.
    n_steps : int
        Number of steps of all members.
    building, running, kernels : float
        Seconds for the problems of the members, for their ensembles, and in the kernels, summed over the threads.
    notes : list of str
    """

    problem: Problem
    parameters: Parameters
    axes: list[Axis]
    columns: dict[str, np.ndarray]
    fixed: dict[str, float]
    measures: list[Measure]
    h: float
    method: Method
    after: float | None
    seed: int | None
    values: dict[str, np.ndarray] = field(init=False)
    errors: dict[str, np.ndarray] = field(init=False, default_factory=dict)
    status: np.ndarray = field(init=False)
    n_steps: int = 0
    building: float = 0.0
    running: float = 0.0
    kernels: float = 0.0
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        m = len(self)
        self.status = np.full(m, Status.INTERRUPTED, dtype=object)
        self.values = {str(measure): np.full(m, np.nan) for measure in self.measures}

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the grid, or (m,) for a random sample."""
        return (len(self),) if self.seed is not None else tuple(axis.count or 0 for axis in self.axes)

    @property
    def completed(self) -> np.ndarray:
        """A mask of shape (m,) of the members that reached the end."""
        return self.status == Status.COMPLETED

    @classmethod
    def plan(
        cls,
        build: Callable[..., Problem],
        axes: Sequence[Axis],
        measures: Sequence[Measure],
        *,
        fixed: Sequence[tuple[str, float]] = (),
        random: int | None = None,
        seed: int = 0,
        h: float | None = None,
        method: str | Method = "eig3",
        t_end: float | None = None,
        after: float | None = None,
    ) -> Study:
        """Check the arguments of a study.

        There are one or two `axes` for a grid, and any number for a random sample with `random` members and a `seed`.
        `fixed` has parameters that differ from the defaults of the problem. The default of h is the shortest default
        step at the corners of the swept region. The members are measured only after the time `after`.

        Raises
        ------
        TypeError, ValueError
            If an argument is not valid.
        """
        if t_end is not None:
            t_end = check_time(t_end, "t_end")
        parameters = Parameters(build, t_end=t_end, work=any(measure.needs_energy for measure in measures))
        entries: set[str] = set()
        for name in (*(axis.name for axis in axes), *(name for name, _ in fixed)):
            entry = parameters.entry(name)
            if entry in entries:
                raise ValueError(f"{name} is given twice: each parameter has one --set or one --fix.")
            entries.add(entry)
        for name, value in fixed:
            is_whole = parameters.is_whole(name)
            if not (math.isfinite(value) and (float(value).is_integer() or not is_whole)):
                wanted = "a whole number" if is_whole else "a finite number"
                raise ValueError(f"--fix {name} must be {wanted}, not {value:g}.")
            if is_whole and abs(value) > MOST_WHOLE:
                raise ValueError(f"--fix {name} takes whole numbers below 2^53, not {value:g}.")
        if not axes or (random is None and len(axes) > 2):
            raise ValueError(f"give one or two parameters with --set, not {len(axes)}; --random takes any number.")
        if seed < 0:
            raise ValueError(f"--seed must be a whole number of at least 0, not {shown(seed)}.")
        if seed and random is None:
            raise ValueError("--seed is for random members: give --random too.")
        m = math.prod(axis.count or 0 for axis in axes) if random is None else random
        check_study(m, len(axes) + len(measures) + 1)
        columns = _columns(axes, parameters, random, seed)
        values = dict(fixed)
        corners = list(_corners(parameters, columns, values))
        for problem, measure in itertools.product(corners, measures):
            measure.function(problem)
        record = check_method(method)
        t0, t1 = corners[0].t_span[0], min(corner.t_span[1] for corner in corners)
        if after is not None and not t0 < check_time(after, "after") < t1:
            raise ValueError(f"--after must be a time between {t0:g} and {t1:g}, the span of the run, not {after:g}.")
        if after is not None and any(history_of(corner.rhs) for corner in corners):
            raise ValueError("--after does not fit: a second run would start without the springs between grains.")
        if h is None:
            h = min(first_step(corner, record, corner.t_span[1] - corner.t_span[0]) for corner in corners)
        return cls(
            corners[0],
            parameters,
            list(axes),
            columns,
            values,
            list(measures),
            check_h(h),
            record,
            after,
            seed=None if random is None else seed,
        )

    def run(self, progress: bool = False) -> None:
        """Run all members. After Ctrl-C, the completed batches are kept."""
        size = self._batch_size()
        with Progress(len(self), "member", shown=progress) as bar:
            for first in range(0, len(self), size):
                members = range(first, min(first + size, len(self)))
                begin = time.perf_counter()
                problems = [self.parameters.problem(self._given(i)) for i in members]
                self.building += time.perf_counter() - begin
                for group in _groups(problems):
                    begin = time.perf_counter()
                    self._run_group([problems[i] for i in group], first + np.array(group))
                    self.running += time.perf_counter() - begin
                bar.add(len(members))

    def check(self, progress: bool = False) -> None:
        """Estimate the errors of the measures from a second study with half the step, by Richardson extrapolation."""
        finer = replace(self, h=self.h / 2, n_steps=0, building=0.0, running=0.0, kernels=0.0, notes=[])
        finer.run(progress)
        whole = 1 / (1 - 0.5**self.method.order)
        self.errors = {name: whole * np.abs(finer.values[name] - values) for name, values in self.values.items()}

    def _given(self, i: int) -> dict[str, float]:
        return {**self.fixed, **{name: column[i] for name, column in self.columns.items()}}

    def _batch_size(self) -> int:
        values = np.size(self.problem.params) + 8 * np.size(self.problem.u0)
        return min(max(1, _BATCH_VALUES // values), max(_LEAST_BATCH, math.ceil(len(self) / _BATCHES)))

    def _run_group(self, problems: list[Problem], members: np.ndarray) -> None:
        """Run members that share their right-hand side, and compute their measures."""
        problem = problems[0]
        start: dict[str, Any] = {name: np.array([getattr(p, name) for p in problems]) for name in ("u0", "v0")}
        start["params"] = _parameters(problems)
        if self.after is not None:
            before = self._ensemble(problem, start, t_end=self.after)
            alive = before.status == Status.COMPLETED
            self.status[members[~alive]] = before.status[~alive]
            if not alive.any():
                return
            problem, members = problem.with_(t_span=(self.after, problem.t_span[1])), members[alive]
            start = {"u0": before.u[alive, -1], "v0": before.v[alive, -1]}
            start["params"] = _parameters([p for p, is_alive in zip(problems, alive, strict=True) if is_alive])
            start |= {"z0": {name: x[alive, -1] for name, x in before.z.items()}} if before.z else {}
        outputs, invariants = dict[Any, str](), dict[Any, str]()  # the name of each function
        names: list[str] = []
        for k, measure in enumerate(self.measures):
            known = invariants if measure.kind == "drift" else outputs
            names.append(known.setdefault(measure.function(problem), f"quantity {k}"))
        by_name = [{name: function for function, name in known.items()} for known in (outputs, invariants)]
        solution = self._ensemble(problem, start, outputs=by_name[0], invariants=by_name[1])
        self.status[members] = solution.status
        for measure, name in zip(self.measures, names, strict=True):
            self.values[str(measure)][members] = measure.of(solution, name, problem)

    def _ensemble(self, problem: Problem, start: Mapping[str, Any], **options: Any) -> Any:
        options = {"invariants": {}, "h": self.h, "method": self.method, **options}
        solution = problem.ensemble(**start, **options)
        self.n_steps += int(solution.n_steps.sum())
        self.kernels += solution.kernel_seconds
        self.notes += [note for note in solution.notes if note not in self.notes]
        return solution


def _parameters(problems: Sequence[Problem]) -> Any:
    """Return the parameters of members: an array, or a list if they have names."""
    params = [problem.params for problem in problems]
    return params if has_names(params[0]) else np.array(params)


def _columns(axes: Sequence[Axis], parameters: Parameters, random: int | None, seed: int) -> dict[str, np.ndarray]:
    """Return the values of each swept parameter, for each member."""
    whole = {axis.name: parameters.is_whole(axis.name) for axis in axes}
    if random is not None:
        rng = np.random.default_rng(seed)
        return {axis.name: axis.sample(rng, random, whole=whole[axis.name]) for axis in axes}
    grids = np.meshgrid(*(axis.grid(whole=whole[axis.name]) for axis in axes), indexing="ij")
    return {axis.name: grid.ravel() for axis, grid in zip(axes, grids, strict=True)}


def _corners(
    parameters: Parameters, columns: Mapping[str, np.ndarray], fixed: Mapping[str, float]
) -> Iterator[Problem]:
    """Return the problems at the corners of the swept region, the first with the lowest values."""
    for corner in itertools.product(*((column.min(), column.max()) for column in columns.values())):
        yield parameters.problem({**fixed, **dict(zip(columns, corner, strict=True))})


def _groups(problems: Sequence[Problem]) -> list[list[int]]:
    """Return groups of problems with the same functions and the same numbers of values."""
    groups: dict[Any, list[int]] = {}
    for i, p in enumerate(problems):
        events = tuple((name, e.g, e.direction, e.terminal, e.apply) for name, e in p.events.items())
        key = p.rhs, p.energy, tuple(p.outputs.items()), p.unknowns, events, p.t_span, np.shape(p.u0), np.size(p.params)
        groups.setdefault(key, []).append(i)
    return list(groups.values())
