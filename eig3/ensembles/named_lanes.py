"""Functions of named parameters in lanes: the members share some parameters, and the others are their own.

The right-hand side and the outputs of a structure are written line by line for lanes; see `eig3.structures.text`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from ..functions.layout import Layout
from .members import Members


class NamedLanes:
    """The named parameters: the `values` of a member, and `own`, the names with a value for each member."""

    def __init__(self, layout: Layout, values: Mapping[str, Any], own: tuple[str, ...]) -> None:
        self._layout, self._values, self._own = layout, values, own

    @classmethod
    def of(cls, rhs: Any, layout: Layout, members: Members) -> NamedLanes | None:
        """Return the parameters of a right-hand side that can be written line by line, and None for others."""
        is_written = hasattr(rhs.py_func.inner.py_func, "line_by_line")
        if not is_written and not (members.has_own_params and all(kind.ndim >= 0 for kind in layout.kinds)):
            return None
        kinds = dict(zip(layout.names, layout.kinds, strict=True))
        own = [kinds[name] for name in (members.own or layout.names) if members.has_own_params]
        if any(kind.ndim < 0 or kind.is_whole for kind in own):
            return None
        values = layout.read(members.params[0] if members.has_own_params else members.params)._asdict()
        return cls(layout, values, members.own if members.has_own_params else ())

    @cached_property
    def columns(self) -> np.ndarray:
        """The places in p of the parameters with a value for each member."""
        places = self._layout.places(self._values)
        own = (np.arange(places[name].start, places[name].stop) for name in self._own)
        return np.concatenate([np.arange(0), *own])

    def function(self, function: Any) -> Callable:
        """Return the Python function for lanes of a function that reads these parameters."""
        inner = getattr(function.py_func, "inner", function)
        if hasattr(inner.py_func, "line_by_line"):
            inner = inner.py_func.line_by_line(self._values)
        if not self._own:
            return self._layout.bind(inner).py_func
        return self._layout.bind_in_lanes(inner, self._values, self._own)
