"""Members that run one at a time, as single runs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np

from ..functions.guard import NotFiniteAtStartError
from ..functions.quantities import Functions
from ..functions.records import shortest_loads
from ..methods import Method
from ..result.solution import Solution, Status
from ..run.prepare import Prepared
from ..stepping.march import Cancel
from ..stepping.run_options import RunOptions
from .histories import Histories
from .members import Members


class Singles:
    """The single runs of members; `changes` are options that differ in them, such as ``save_every=None``."""

    def __init__(self, rhs: Any, members: Members, options: RunOptions, **changes: Any) -> None:
        self.rhs, self._members, self._options = rhs, members, options._replace(**changes)
        self._shared: Prepared | None = None

    @cached_property
    def plain(self) -> Singles:
        """The single runs without events, invariants and outputs."""
        none: dict[str, Any] = {"save_every": None, "t_eval": None, "events": {}, "functions": Functions({}, {})}
        return Singles(self.rhs, self._members, self._options, **none)

    @cached_property
    def longest(self) -> np.ndarray:
        """The longest step of each member that jumps over no load of a record, shape (m,)."""
        members = self._members
        return np.broadcast_to(shortest_loads(self.rhs, members.params, members.own) / 2, len(members))

    def prepared(self, i: int) -> Prepared:
        """Return the prepared run of member i, which all members share if they have the same step and no noise."""
        members, method = self._members, self._options.method
        h = None if self._options.tolerances else float(members.steps[i])
        if members.has_own_step or method.is_stochastic:
            return self._prepared(h, method.of_member(members.first + i))
        if self._shared is None:
            self._shared = self._prepared(h, method)
        return self._shared

    def __call__(self, i: int, cancel: Cancel | None = None) -> Solution:
        """Integrate member i."""
        return self.prepared(i).member(self._members.t_span, *self._members.start(i), cancel, float(self.longest[i]))

    def _prepared(self, h: float | None, method: Method) -> Prepared:
        return Prepared(self.rhs, self._members.form, self._options._replace(h=h, method=method))


class Alone:
    """Some members of an ensemble, by their numbers, that run one at a time."""

    def __init__(self, numbers: np.ndarray, histories: Histories, single: Singles) -> None:
        self.numbers, self.histories, self.single = numbers, histories, single
        self.seconds = 0.0  # in the kernel

    def __len__(self) -> int:
        return len(self.numbers)

    def run(self, stop: Cancel) -> None:
        """Run the members, or the members until `stop` is set."""
        self.run_alone(self.numbers, stop)

    def run_alone(self, numbers: Iterable[int], stop: Cancel) -> None:
        """Run some of the members one at a time."""
        for member in numbers:
            if stop.is_set():
                return
            try:
                solution = self.single(int(member), stop)
            except NotFiniteAtStartError as error:
                self.histories.judge(int(member), Status.DIVERGED, str(error))
                continue
            self.seconds += solution.kernel_seconds
            self.histories.take(int(member), solution)
