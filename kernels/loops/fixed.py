# ruff: noqa: F821
"""The kernel of a fixed-step method, made from the formulas in the method's file.

`scalar`, `vector` and `stacked` are templates: the names in capitals stand for values that depend on the method.
`Formulas.names` provides these values, and `jit.bound` inserts them.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

from numba.types import Tuple, int64, none

from ..compile.jit import bound, compile_kernel, element
from ..compile.numba_internals import has_wide_vectors, wide_vectors
from ..compile.source import define
from ..protocol import (
    EVALUATIONS,
    SCALAR,
    VECTOR,
    Form,
    Work,
    copy_rows,
    floats,
    function_at,
    rows,
    stack_rows,
    vector_type,
)
from .march import march_scalar, march_vector, settle

METHODS = f"{__package__.rpartition('.')[0]}.methods"  # the package with one file for each method

#: Largest number of degrees of freedom for which the inline mode keeps all rows on the stack. With more, rows on the
#: heap are as fast, and the kernel compiles in a third of the time.
STACKED_DEGREES = 6


def scalar(callbacks, state, settings, tally, run):
    f = RHS(callbacks)
    c = CONSTANTS(settings, run.h, Work(tally, None, JACOBIAN(callbacks)))
    y, begin, row = floats(state, VALUES), run.first, 0
    if START_STEPS > 0:
        begin = max(run.first, min(run.first + run.count, START_STEPS))
        y, _, row = march_scalar(START_STEP, f, y, c, run, run.first, begin, row)
    y, end, row = march_scalar(STEP, f, y, c, run, begin, run.first + run.count, row)
    for k in range(VALUES):
        state[k] = y[k]
    tally[EVALUATIONS] += START_COST * (begin - run.first) + COST * (end - begin)
    return end - run.first


def vector(callbacks, state, settings, tally, run):
    n = N if N > 0 else state.shape[1]
    f = RHS(callbacks)
    c = CONSTANTS(settings, run.h, Work(tally, state[ROWS:], JACOBIAN(callbacks)))
    y, begin, row = rows(state, OWN_ROWS), run.first, 0
    if START_STEPS > 0:
        begin = max(run.first, min(run.first + run.count, START_STEPS))
        y, _, row = march_vector(START_STEP, nothing, f, y, (c, state[OWN_ROWS:]), n, run, run.first, begin, row)
    y, end, row = march_vector(STEP, COMPLETE, f, y, c, n, run, begin, run.first + run.count, row)
    settle(y, state, n)
    tally[EVALUATIONS] += START_COST * (begin - run.first) + COST * (end - begin)
    return end - run.first


def stacked(callbacks, state, settings, tally, run):
    f = RHS(callbacks)
    c = CONSTANTS(settings, run.h, Work(tally, state[ROWS:], JACOBIAN(callbacks)))
    kept, begin, row = rows(state, OWN_ROWS), run.first, 0
    y = stack_rows(N, OWN_ROWS)
    copy_rows(y, kept, N)
    if START_STEPS > 0:
        begin = max(run.first, min(run.first + run.count, START_STEPS))
        y, _, row = march_vector(START_STEP, nothing, f, y, (c, state[OWN_ROWS:]), N, run, run.first, begin, row)
    y, end, row = march_vector(STEP, COMPLETE, f, y, c, N, run, begin, run.first + run.count, row)
    copy_rows(kept, y, N)
    tally[EVALUATIONS] += START_COST * (begin - run.first) + COST * (end - begin)
    return end - run.first


def start_scalar(f, at, y, c):
    """Take u and v from a step of the starter, and the past values from a step of the method itself."""
    y_next, _ = STEP(f, at, y, c)
    u, v, success = STARTER(f, at, y[0], y[1])
    started = u, v
    return started + y_next[2:], success


def start_vector(f, at, y, c, n):
    c, scratch = c
    kept = rows(scratch, 2)
    for j in range(n):
        kept[0][j], kept[1][j] = y[0][j], y[1][j]
    y, _ = STEP(f, at, y, c, n)
    u, v = y[0], y[1]
    for j in range(n):
        u[j], v[j] = kept[0][j], kept[1][j]
    return y, STARTER(f, at, u, v, scratch, n)


def starter_scalar(f, at, u, v):
    """Return u and v after a step of the starter, and whether it succeeded."""
    y, success = THEIR_STEP(f, at, (u, v), THEIR_CONSTANTS((), at.h, None))
    return y[0], y[1], success


def starter_vector(f, at, u, v, scratch, n):
    """Advance u and v by a step of the starter, and return whether it succeeded."""
    y = rows(scratch, THEIR_ROWS)
    for j in range(n):
        y[0][j], y[1][j] = u[j], v[j]
    y, success = THEIR_STEP(f, at, y, THEIR_CONSTANTS((), at.h, None), n)
    for j in range(n):
        u[j], v[j] = y[0][j], y[1][j]
    return success


def stack_step(f, at, y, c, n):
    """A step that moves values and not rows, so that rows on the stack can be registers."""
    y_next, success = STEP(f, at, y, c, N)
    if success:
        copy_rows(y, y_next, N)
    return y, success


@element
def no_constants(settings, h, work):
    return ()


@element
def nothing(y, c, h, n):
    pass


class Formulas:
    """The names that a method's file defines, with defaults for those that it leaves out.

    Parameters
    ----------
    module : module
        The method's file, as `eig3.kernels` describes it.
    arguments : tuple
        For a family of methods, the arguments of the file's function `member`, which returns the names.

    Raises
    ------
    TypeError
        If a required name is missing, or if there is only one of START and START_STEPS.
    """

    def __init__(self, module: ModuleType, arguments: tuple = ()) -> None:
        defined: Any = module.member(*arguments) if arguments else module
        missing = [name for name in ("ROWS", "step_scalar", "step_vector") if not hasattr(defined, name)]
        if missing:
            raise TypeError(f"kernel {module.__name__!r} must define {', '.join(missing)}: see eig3.kernels.")
        self.module, self.defined = module, defined
        self.label = "_".join([module.__name__, *map(str, arguments)])
        self.past: int = getattr(defined, "PAST", 0)
        self.matrix: bool = getattr(defined, "MATRIX", False)
        self.turn: int = getattr(defined, "TURN", 6)
        self.start: Callable = getattr(defined, "start", None) or _start_at_zero(self.past)
        starter = getattr(defined, "START", None)
        self.starter = formulas(f"{METHODS}.{starter}") if starter else None
        self.start_steps: int = getattr(defined, "START_STEPS", 0)
        if bool(self.starter) != (self.start_steps > 0):
            raise TypeError(f"kernel {module.__name__!r} must define START and START_STEPS together or neither.")

    @property
    def own_rows(self) -> int:
        """Number of rows of the vector form: u, v, the past, and scratch."""
        return self.defined.ROWS

    @property
    def rows(self) -> int:
        """Number of these rows and of those of the starter, which only the first steps use."""
        return self.own_rows + (self.starter.rows if self.starter else 0)

    def state_rows(self, n: int) -> int:
        """Return the number of rows of the state for n degrees of freedom, including the matrix."""
        return self.rows + n * self.matrix

    def names(self, form: Form) -> dict[str, Any]:
        """Return the values of the names in capitals in a template."""
        defined = self.defined
        cost = getattr(defined, "EVALUATIONS", 0)
        names = {
            "CONSTANTS": getattr(defined, "constants", no_constants),
            "COMPLETE": getattr(defined, "complete", nothing),
            "STEP": getattr(defined, f"step_{form.name}"),
            "VALUES": 2 + self.past,
            "ROWS": self.rows,
            "OWN_ROWS": self.own_rows,
            "START_STEPS": self.start_steps,
            "COST": cost,
            "START_COST": cost,
        }
        if self.starter:
            begin = getattr(defined, f"start_step_{form.name}", start_scalar if form is SCALAR else start_vector)
            steps = {"STEP": names["STEP"], "STARTER": self.starter._as_starter(form)}
            names["START_STEP"] = element(bound(begin, steps))
            names["START_COST"] += self.starter.names(form)["COST"]
        return names

    def _as_starter(self, form: Form) -> Any:
        """Return the function that takes a step for another method."""
        brief = getattr(self.defined, "brief_step_vector", None)
        if brief and form is VECTOR:
            return brief
        mine = self.names(form)
        theirs = {"THEIR_STEP": mine["STEP"], "THEIR_CONSTANTS": mine["CONSTANTS"], "THEIR_ROWS": self.defined.ROWS}
        return element(bound(starter_scalar if form is SCALAR else starter_vector, theirs))

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
    return _formulas(module, arguments, getattr(module, "step_scalar", None), getattr(module, "step_vector", None))


@functools.cache
def _formulas(module: ModuleType, arguments: tuple, *steps: Any) -> Formulas:
    return Formulas(module, arguments)


@functools.cache
def pointer_kernel(method: Formulas, form: Form, takes_jacobian: bool = False, is_pair: bool = False) -> Any:
    """Compile the kernel of a method for callbacks given as addresses, or load it from the disk.

    With `is_pair`, it is valid for two degrees of freedom only: the compiler then removes the loops over them, and a
    pendulum takes up to a quarter less time.

    The kernel of a method outside this package is compiled in each process: its formulas may use other files, and a
    change of these would go unnoticed.

    The kernel is called as ``kernel((rhs, jacobian or None), state, settings, tally, run)``, and returns the number of
    steps that it took. This is less than `run.count` if a solve failed.
    """
    label = f"{method.label}{'_jacobian' * takes_jacobian}{'_pair' * is_pair}" if method.is_own else ""
    return _compile_pointer_kernel(method.names(form), form, label, takes_jacobian, 2 if is_pair else 0)


def _compile_pointer_kernel(
    names: dict[str, Any], form: Form, label: str, takes_jacobian: bool = False, n: int = 0
) -> Any:
    callbacks, functions = pointer_callbacks(form, takes_jacobian)
    names |= {"N": n, **functions}
    signature = int64(callbacks, form.state, vector_type, vector_type, form.run)
    return compile_kernel(scalar if form is SCALAR else vector, names, signature, label)


@functools.cache
def pointer_callbacks(form: Form, takes_jacobian: bool) -> tuple[Any, dict[str, Any]]:
    """Return the type of the argument `callbacks` of a kernel, and the functions that take the callbacks out of it."""
    rhs_at, jacobian_at = function_at(form.rhs), function_at(form.jacobian)
    names = {
        "RHS": element(lambda callbacks: rhs_at(callbacks[0])),
        "JACOBIAN": element((lambda callbacks: jacobian_at(callbacks[1])) if takes_jacobian else no_jacobian),
    }
    return Tuple((int64, int64 if takes_jacobian else none)), names


def inline_callbacks(rhs: Any, jacobian: Any) -> tuple[Any, dict[str, Any]]:
    """Return the same for a kernel with its callbacks inlined."""
    names = {
        "RHS": element(lambda callbacks: rhs),
        "JACOBIAN": element((lambda callbacks: jacobian) if jacobian else no_jacobian),
    }
    return Tuple(()), names


@functools.cache
def wide_kernel(method: Formulas) -> Any:
    """Return the kernel of the vector form for a block of trajectories, see `eig3.kernels.lanes`.

    It is `pointer_kernel`, but with the widest vectors that the processor has. The loops are in the elements of the
    method: these are compiled anew.
    """
    if not has_wide_vectors():
        return pointer_kernel(method, VECTOR)
    names = method.names(VECTOR)
    for name in ("STEP", "COMPLETE"):
        names[name] = element(names[name].py_func)
    with wide_vectors():
        return _compile_pointer_kernel(names, VECTOR, f"{method.label}_wide" if method.is_own else "")


def no_jacobian(callbacks):
    return None


def inline_kernel(method: Formulas, form: Form, rhs: Any, jacobian: Any, n: int) -> Any:
    """Compile the kernel of a method with one right-hand side inlined. It is called as ``kernel((), state, ...)``.

    If `n` is not 0, the kernel is valid for n degrees of freedom only, and keeps its rows on the stack.
    """
    callbacks, functions = inline_callbacks(rhs, jacobian)
    names = {**method.names(form), "N": n, **functions}
    if n:
        for name in {"STEP", "START_STEP"} & names.keys():
            names[name] = element(bound(stack_step, {"STEP": names[name], "N": n}))
    template = scalar if form is SCALAR else stacked if n else vector
    signature = int64(callbacks, form.state, vector_type, vector_type, form.run)
    return compile_kernel(template, names, signature)
