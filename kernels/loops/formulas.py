# ruff: noqa: F821
"""The formulas of a fixed-step method, which are the names that the method's file defines, and its starter."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

from ..compile.jit import bound, element
from ..compile.source import define
from ..protocol import SCALAR, VECTOR, Form, pointers, rows, stack_floats

METHODS = f"{__package__.rpartition('.')[0]}.methods"  # the package with one file for each method


def start_step(f, at, y, c, n):
    """Take u and v from a step of the starter, and the past values from a step of the method itself."""
    c, scratch = c
    kept = ROWS_OF(scratch, 2)
    for j in range(n):
        kept[0][j], kept[1][j] = y[0][j], y[1][j]
    y, _ = STEP(f, at, y, c, n)
    u, v = y[0], y[1]
    for j in range(n):
        u[j], v[j] = kept[0][j], kept[1][j]
    return y, STARTER(f, at, u, v, scratch, n)


def starter(f, at, u, v, scratch, n):
    """Advance u and v by a step of the starter, and return whether it succeeded."""
    y = SCRATCH_ROWS(scratch, THEIR_ROWS)
    for j in range(n):
        y[0][j], y[1][j] = u[j], v[j]
    y, success = THEIR_STEP(f, at, y, THEIR_CONSTANTS((), at.h, None), n)
    for j in range(n):
        u[j], v[j] = y[0][j], y[1][j]
    return success


@element
def no_constants(settings, h, work):
    return ()


@element
def nothing(y, c, h, n):
    pass


class Formulas:
    """The names that a method's file, the `module`, defines, with defaults for those that it leaves out.

    For a family of methods, `arguments` are for the file's function `member`, which returns the names.

    Raises
    ------
    TypeError
        If a required name is missing, or if there is only one of START and START_STEPS.
    """

    def __init__(self, module: ModuleType, arguments: tuple = ()) -> None:
        defined: Any = module.member(*arguments) if arguments else module
        missing = [name for name in ("ROWS", "step") if not hasattr(defined, name)]
        if missing:
            raise TypeError(f"kernel {module.__name__!r} must define {', '.join(missing)}: see eig3.kernels.")
        self.module, self.defined = module, defined
        self.label = "_".join([module.__name__, *map(str, arguments)])
        self.past: int = getattr(defined, "PAST", 0)
        self.evaluations: int | None = getattr(defined, "EVALUATIONS", None)
        self.matrix: bool = getattr(defined, "MATRIX", False)
        self.keeps_constraints: bool = getattr(defined, "KEEPS_CONSTRAINTS", False)
        self.turn: int = getattr(defined, "TURN", 6)
        self.start: Callable = getattr(defined, "start", None) or _start_at_zero(self.past)
        starter = getattr(defined, "START", None)
        self.starter = formulas(f"{METHODS}.{starter}") if starter else None
        self.start_steps: int = getattr(defined, "START_STEPS", 0)
        if bool(self.starter) != (self.start_steps > 0):
            raise TypeError(f"kernel {module.__name__!r} must define START and START_STEPS together or neither.")

    @property
    def own_rows(self) -> int:
        """Number of rows: u, v, the past, and scratch."""
        return self.defined.ROWS

    @property
    def rows(self) -> int:
        """Number of these rows and of the rows of the starter, which only the first steps use."""
        return self.own_rows + (self.starter.rows if self.starter else 0)

    def state_rows(self, n: int) -> int:
        """Return the number of rows of the state for n degrees of freedom, including the matrix."""
        return self.rows + n * self.matrix

    def names(self, form: Form) -> dict[str, Any]:
        """Return the values of the names in capitals in a template."""
        step, cost = self._element("step"), self.evaluations or 0
        names = {
            "CONSTANTS": self._element("constants", no_constants),
            "COMPLETE": self._element("complete", nothing),
            "STEP": self._element("step_of_one", step) if form is SCALAR else step,
            "ROWS_OF": pointers if form is SCALAR else rows,
            "ROWS": self.rows,
            "OWN_ROWS": self.own_rows,
            "CARRIED": 2 + self.past,
            "IS_CHECKED": int(not self.is_own),
            "START_STEPS": self.start_steps,
            "COST": cost,
            "START_COST": cost,
        }
        if self.starter:
            steps = {"STEP": names["STEP"], "ROWS_OF": names["ROWS_OF"], "STARTER": self.starter._as_starter(form)}
            names["START_STEP"] = element(bound(getattr(self.defined, "start_step", start_step), steps))
            names["START_COST"] += self.starter.names(form)["COST"]
        return names

    def _element(self, name: str, default: Any = None) -> Any:
        """Return a function of the file as an element; the file may leave out the decorator."""
        function = getattr(self.defined, name, default)
        return element(function) if isinstance(function, FunctionType) else function

    def _as_starter(self, form: Form) -> Any:
        """Return the function that takes a step for another method."""
        brief = self._element("brief_step")
        if brief and form is VECTOR:
            return brief
        mine = self.names(form)
        theirs = {
            "SCRATCH_ROWS": stack_floats if form is SCALAR else rows,
            "THEIR_STEP": mine["STEP"],
            "THEIR_CONSTANTS": mine["CONSTANTS"],
            "THEIR_ROWS": self.defined.ROWS,
        }
        return element(bound(starter, theirs))

    @property
    def is_own(self) -> bool:
        """Whether all formulas are in this package."""
        starter_is_own = self.starter is None or self.starter.is_own
        return starter_is_own and self.module.__name__.rpartition(".")[0] == METHODS


def _start_at_zero(past: int) -> Callable:
    """Return a function `start` for past values that the first steps do not need."""
    return define(f"def start(u, v, a, h):\n    return ({'0 * u, ' * past})\n", "start", {})["start"]


def formulas(name: str, arguments: tuple = ()) -> Formulas:
    """Return the formulas of a module, given by its name. A module that was reloaded is read again."""
    module = importlib.import_module(name)  # not from sys.modules, where another thread may just be importing it
    return _formulas(module, arguments, getattr(module, "step", None))


def variable_formulas(name: str) -> Any:
    """Return the formulas for steps of variable length in the file of this name in `eig3.kernels.methods`."""
    return importlib.import_module(f"{METHODS}.{name}").variable


@functools.cache
def _formulas(module: ModuleType, arguments: tuple, step: Any) -> Formulas:
    return Formulas(module, arguments)
