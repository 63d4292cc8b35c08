"""What determines the result of an ensemble. It is stored beside the parts, so that the ensemble can continue later."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..functions.events import check_events
from ..functions.first_order import FirstOrder
from ..functions.layout import Layout
from ..functions.quantities import check_functions
from ..kernels.compile.captured import captured_text, is_plain
from ..kernels.compile.content import content
from ..kernels.compile.numba_internals import Jitted
from ..kernels.protocol import SCALAR, VECTOR
from ..stepping.run_options import RunOptions
from ..stepping.tolerances import Tolerances
from .members import Members

#: The marks of an ensemble, by the names of its arguments. An empty text is a function whose content is unknown.
Marks = Mapping[str, tuple[str, ...]]

_OF_MEMBERS = "t_span", "u0", "v0", "h", "n_steps", "own"


def recipe_of(rhs: Any, members: Members, options: RunOptions) -> dict[str, Any]:
    """Return the values that a file keeps: all that `restored` needs except the params, and the marks."""
    method, layout, functions = options.method, options.layout, options.functions
    named = {"events": options.events, "invariants": functions.invariants, "outputs": functions.outputs}
    return {
        "method": method if method.jacobian is None else dataclasses.replace(method, jacobian=None),
        "has_jacobian": method.jacobian is not None,
        "is_scalar": members.form is SCALAR,
        **{name: getattr(members, name) for name in _OF_MEMBERS},
        "step": options.h,
        **{name: getattr(options, name) for name in ("tolerances", "save_every", "t_eval", "labels", "first_order")},
        "layout": layout and layout.text,
        "names": {name: tuple(each) for name, each in named.items()},
        "invariants_every": functions.invariants_every,
        "marks": marks(rhs, members, options),
    }


def restored(
    recipe: Mapping[str, Any], params: np.ndarray, rhs: Any, given: Mapping[str, Any]
) -> tuple[Any, Members, RunOptions]:
    """Return the right-hand side, the members and the options of an ensemble from its recipe and its functions.

    Raises
    ------
    TypeError, ValueError
        If a function is not valid, or the names of the functions differ from the ensemble.
    """
    first_order, method = FirstOrder(*recipe["first_order"]), recipe["method"]
    functions, jacobian = {name: first_order.bind_all(given[name]) for name in recipe["names"]}, given["jacobian"]
    rhs = first_order.bind_rhs(rhs)
    layout = Layout.of_text(recipe["layout"]) if recipe["layout"] else None
    if layout:
        rhs, jacobian = layout.bind(rhs), layout.bind(jacobian)
        functions = {name: layout.bind_all(each) for name, each in functions.items()}
    for name, known in recipe["names"].items():
        functions[name] = _in_order(name, functions[name], known)
    if (jacobian is not None) != recipe["has_jacobian"]:
        what = "the method of the run has a jacobian: give" if jacobian is None else "the run has none: leave out"
        raise ValueError(f"{what} jacobian.")
    if jacobian is not None:
        method = dataclasses.replace(method, jacobian=jacobian)
    form = SCALAR if recipe["is_scalar"] else VECTOR
    given_members = {name: recipe[name] for name in _OF_MEMBERS}
    members = Members(form=form, params=params, **given_members)
    options = RunOptions(
        h=recipe["step"],
        tolerances=recipe["tolerances"] and Tolerances(*recipe["tolerances"]),
        method=method,
        save_every=recipe["save_every"],
        t_eval=recipe["t_eval"],
        events=check_events(functions["events"]),
        functions=check_functions(functions["invariants"], functions["outputs"], recipe["invariants_every"]),
        labels=recipe["labels"],
        first_order=first_order,
        layout=layout,
    )
    return rhs, members, options


def marks(rhs: Any, members: Members, options: RunOptions) -> Marks:
    """Return texts that differ if the result does, by the names of the arguments of `ensemble`.

    The content of a function is a digest of its bytecode and of the values that it reads from outside.
    """
    functions = options.functions
    found: dict[str, tuple[str, ...]]
    found = {name: (_text(getattr(members, name)),) for name in ("t_span", "u0", "v0", "h")}
    found["params"] = _text(members.params), _text(members.own)
    found["method"] = _text(options.method), _content(options.method.jacobian)
    found |= {"rtol": (_text(options.tolerances),), "z0": (_text(options.first_order),)}
    found |= {name: (_text(getattr(options, name)),) for name in ("save_every", "t_eval")}
    found["rhs"] = (_content(rhs),)
    shapes = _text(tuple(functions.shapes.items()))
    found["outputs"] = shapes, *map(_content, functions.outputs.values())
    spacing = _text((functions.invariants_every, *functions.invariants))
    found["invariants"] = spacing, *map(_content, functions.invariants.values())
    events = options.events.items()
    kinds = _text(tuple((name, each.direction, each.terminal, each.apply is not None) for name, each in events))
    found["events"] = kinds, *(_content(x) for _, each in events for x in (each.g, each.apply))
    return found


def differing(one: Marks, other: Marks) -> list[str]:
    """Return the names of the arguments in which two ensembles differ."""

    def agrees(name: str) -> bool:
        pair = one[name], other.get(name, ())
        return len(pair[0]) == len(pair[1]) and all(x == y or not (x and y) for x, y in zip(*pair, strict=True))

    return [name for name in one if not agrees(name)]


def _in_order(argument: str, given: Any, names: tuple[str, ...]) -> Any:
    """Return a dictionary of functions in the order of the ensemble, in which simultaneous events occur."""
    if set(given or {}) != set(names):
        wanted = ", ".join(map(repr, names)) or "none"
        raise ValueError(f"{argument} must have the same names as in the ensemble: {wanted}.")
    return {name: given[name] for name in names}


def _text(value: Any) -> str:
    """Return a text that tells a value from others; the functions in it are left out."""
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    if isinstance(value, np.generic):
        value = value.item()  # a file keeps numbers of Python
    if is_plain(value):
        return captured_text(value)
    if dataclasses.is_dataclass(value):
        values = (f"{each.name}={_text(getattr(value, each.name))}" for each in dataclasses.fields(value))
        return f"{type(value).__qualname__}({', '.join(values)})"
    return ""


def _content(function: Any) -> str:
    """Return a digest of a function, or of the function of an output or an invariant; empty if it is unknown."""
    function = function[0] if isinstance(function, tuple) else function
    return content(function, is_named=False) if isinstance(function, Jitted) else ""
