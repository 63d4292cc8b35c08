"""The parameters of a problem: the arguments of its function, and the entries of its initial values."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..problem import Problem

_KEPT = 64  # problems that are kept for members that differ only in the initial values
_START = re.compile(r"([uv]0)(?:\[(\d+)\])?")
_ATOM = r"(?:kg|rad|m|s|N|J)(?:\^(?:\d+|\(\d+/\d+\)))?"
_PRODUCT = rf"{_ATOM}(?: {_ATOM})*"
_UNIT = rf"(?:1/)?\(?{_PRODUCT}\)?(?:/(?:{_PRODUCT}|\({_PRODUCT}\)))?"


class Parameters:
    """The parameters of one of `eig3.problems`: the numerical arguments of its function, and entries of the start.

    These are the entries u0[i] and v0[i] of the initial values. `t_end` is the end of the run; by default the end of
    the problem's span. With `work`, the work is integrated if the problem has this option.
    """

    def __init__(self, build: Callable[..., Problem], *, t_end: float | None = None, work: bool = False) -> None:
        arguments = inspect.signature(build, eval_str=True).parameters
        self.build = build
        self.kinds = {name: a.annotation for name, a in arguments.items() if a.annotation in (float, int)}
        self.kinds.pop("t_end", None)
        self._options: dict[str, Any] = {} if t_end is None else {"t_end": t_end}
        if work and "work" in arguments:
            self._options["work"] = True
        self._built = functools.lru_cache(maxsize=_KEPT)(lambda given: build(**dict(given), **self._options))

    def entry(self, name: str) -> str:
        """Return the name of a parameter, u0[0] also for u0, or raise a ValueError if there is no such parameter."""
        start = _START.fullmatch(name)
        if name in self.kinds:
            return f"{name}[0]" if start else name
        if not start:
            names = ", ".join([*self.kinds, "u0[i]", "v0[i]"])
            raise ValueError(f"{self.build.__name__} has the parameters {names}, but not {name}.")
        n, entry = np.size(self.problem({}).u0), start[2]
        if (entry is None and n > 1) or int(entry or 0) >= n:
            last = f"{start[1]}[0] to {start[1]}[{n - 1}]" if n > 1 else start[1]
            raise ValueError(f"the start of {self.build.__name__} has the entries {last}, but not {name}.")
        return f"{start[1]}[{int(entry or 0)}]"

    def is_whole(self, name: str) -> bool:
        """Return whether a parameter takes whole numbers only."""
        return self.kinds.get(name) is int

    def unit(self, name: str, problem: Problem) -> str:
        """Return the unit of a parameter from the docstring of the function; empty if it gives no unit."""
        start = _START.fullmatch(name)
        if start:
            return problem.unit(start[1][0], int(start[2] or 0))
        return _documented_unit(inspect.getdoc(self.build) or "", name)

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem for some values of its parameters."""
        given = {name: self.kinds[name](value) for name, value in values.items() if name in self.kinds}
        problem = self._built(tuple(given.items()))
        rest = {name: value for name, value in values.items() if name not in self.kinds}
        if not rest:
            return problem
        start = {"u0": np.array(problem.u0, dtype=np.float64), "v0": np.array(problem.v0, dtype=np.float64)}
        for name, value in rest.items():
            match = _START.fullmatch(name)
            assert match
            start[match[1]].flat[int(match[2] or 0)] = value
        return problem.with_(**start)


def _documented_unit(text: str, name: str) -> str:
    """Return the unit in the paragraph of a parameter in a docstring in NumPy style.

    The unit ends the first part, as in "Mass, kg". A paragraph of several parameters may give their units in brackets,
    in order.
    """
    for names, paragraph in re.findall(r"^(\w+(?:, \w+)*) : .*\n((?:    .*\n?)+)", text, flags=re.MULTILINE):
        if name in names.split(", "):
            own = re.findall(rf"\(({_UNIT})\)", paragraph)
            if len(own) == names.count(",") + 1 > 1:
                return own[names.split(", ").index(name)]
            match = re.search(rf"(?:^ *|, )({_UNIT})[.;:]?(?: |$)", paragraph.split(".\n")[0].replace("\n   ", ""))
            return match[1] if match else ""
    return ""
