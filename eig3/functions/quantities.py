"""Quantities: the invariants and outputs of a run, compiled functions evaluated along the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..kernels.compile.numba_internals import Jitted
from ..kernels.protocol import Form
from .callbacks import check_callback, takes
from .checks import check_count, check_names, shown
from .guard import beyond, guarded


class EnergyLessWork(NamedTuple):
    """An energy minus the work, as an entry of `invariants` in a problem that integrates the work.

    The velocity of the degree of freedom `work` is the work.
    """

    energy: Any
    work: int


class Functions(NamedTuple):
    """The functions that are evaluated along a run, by name, as the user or a problem passed them.

    Attributes
    ----------
    invariants : mapping of str to jitted function, or to EnergyLessWork
    outputs : mapping of str to jitted function, to (jitted function, k), or to (jitted function, names of k values)
    invariants_every : int
        The invariants are evaluated after about every so many steps.
    """

    invariants: Mapping[str, Any]
    outputs: dict[str, Any]
    invariants_every: int = 1

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of the value of each output: () or (k,)."""
        return {name: shape_of(value) for name, value in self.outputs.items()}

    @property
    def columns(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """The outputs whose values have names, and these names."""
        pairs = ((name, value[1]) for name, value in self.outputs.items() if isinstance(value, tuple))
        return tuple((name, names) for name, names in pairs if isinstance(names, tuple))

    @property
    def n_outputs(self) -> int:
        """The number of values of all outputs in a state."""
        return sum(k for shape in self.shapes.values() for k in shape or (1,))

    def work_in(self, name: str) -> int | None:
        """The degree of freedom whose velocity is the work that an invariant subtracts, or None."""
        invariant = self.invariants[name]
        return invariant.work if isinstance(invariant, EnergyLessWork) else None

    def quantities(self, form: Form) -> tuple[dict[str, Quantity], dict[str, Quantity]]:
        """Compile the invariants and the outputs."""
        invariants = {
            name: Quantity(f"invariants[{name!r}]", e.energy if isinstance(e, EnergyLessWork) else e, form=form)
            for name, e in self.invariants.items()
        }
        outputs = {
            name: Quantity(f"outputs[{name!r}]", value[0] if isinstance(value, tuple) else value, *shape, form=form)
            for (name, value), shape in zip(self.outputs.items(), self.shapes.values(), strict=True)
        }
        return invariants, outputs


def shape_of(output: Any) -> tuple[int, ...]:
    """Return the shape of the value of an output: () or (k,)."""
    if not isinstance(output, tuple):
        return ()
    _, k = output
    return (len(k) if isinstance(k, tuple) else k,)


def check_functions(invariants: Any, outputs: Any, invariants_every: Any = 1) -> Functions:
    """Return the functions that are evaluated along a run, in dictionaries that the caller cannot change.

    Raises
    ------
    TypeError, ValueError
        If an argument is not a dictionary, a name is not a string, both have the same name, or an output is neither a
        function nor a pair of a function and the number or the names of its values.
    """
    if invariants is not None and not isinstance(invariants, Mapping):
        raise TypeError("invariants must be a dictionary of names and jitted functions, such as {'energy': energy}.")
    if outputs is not None and not isinstance(outputs, Mapping):
        raise TypeError(
            "outputs must be a dictionary of names and jitted functions, such as {'force': force}, or "
            "{'forces': (forces, k)} for k values."
        )
    every = check_count(invariants_every, "invariants_every")
    functions = Functions(dict(invariants or {}), dict(outputs or {}), every)
    check_names(functions.invariants, "invariants")
    check_names(functions.outputs, "outputs")
    for name, value in functions.outputs.items():
        if name in functions.invariants:
            raise ValueError(f"{name!r} is the name of an invariant and of an output; give them different names.")
        if isinstance(value, tuple):
            if len(value) != 2:
                raise TypeError(f"outputs[{name!r}] must be a function or a pair (function, k), not {value!r}.")
            functions.outputs[name] = value[0], _number_or_names(value[1], f"outputs[{name!r}]")
        elif isinstance(value, Jitted) and takes(value.py_func, 5) and not takes(value.py_func, 4):
            raise TypeError(f"outputs[{name!r}] writes its values: give (function, k) with their number k.")
    return functions


def _number_or_names(k: Any, said: str) -> Any:
    """Return the number of values of an output, or their names."""
    if not isinstance(k, list | tuple):
        return check_count(k, f"the number of values k in {said} = (function, k)")
    if not k or not all(isinstance(name, str) for name in k) or len({*k}) < len(k):
        raise ValueError(f"{said} = (function, names) must have a different text for each value, not {shown(k)}.")
    return tuple(k)


class Quantity:
    """A function of the state that is evaluated along a run, compiled as `callback`.

    It writes k values, or returns its only value if k is None: `shape` is (k,) or (), and `width` is the number of
    values. `name` is the name of the argument in errors, such as "outputs['force']".

    Raises
    ------
    TypeError
        If the function is not valid.
    MemoryError
        If the values do not fit into memory.
    """

    def __init__(self, name: str, function: Any, k: int | None = None, *, form: Form) -> None:
        self.name, self.function, self.form = name, function, form
        self.shape = () if k is None else (k,)
        self.width = k or 1
        self.kind = "invariant" if k is None else "output"
        self.callback = check_callback(function, self.kind, form, name)
        try:
            np.empty(self.width)
        except (MemoryError, ValueError):  # ValueError if no array can be so large
            raise MemoryError(
                f"{name} has {self.width:.3g} values, which do not fit into memory; take a smaller k."
            ) from None

    def at_start(self, t: float, u: Any, v: Any, p: np.ndarray, values: np.ndarray) -> None:
        """Evaluate the function in the first state into `values`, and check that it writes its values.

        Raises
        ------
        ValueError
            If the function does not write all of its k values, or writes beyond them.
        """
        if not self.shape:
            values[0] = self.callback.call(t, u, v, p)
            return
        out = guarded(values)  # private to this thread
        out.fill(np.nan)
        self.callback.call(t, u, v, p, out)
        if beyond(out):
            raise self.written_beyond()
        values[:] = out
        self._check_written(t, u, v, p, values)

    def value(self, t: float, u: Any, v: Any, p: np.ndarray) -> Any:
        """Return the value in a state: a float, or an array of k values."""
        if not self.shape:
            return self.callback.call(t, u, v, p)
        out = np.full(self.width, np.nan)
        self.callback.call(t, u, v, p, out)
        return out

    def _check_written(self, t: float, u: Any, v: Any, p: np.ndarray, values: np.ndarray) -> None:
        """Raise a ValueError if the function does not write one of its values."""
        if not np.isnan(values).any():
            return
        out = np.zeros(self.width)  # a value that the function computes may be NaN too
        self.callback.call(t, u, v, p, out)
        unwritten = np.flatnonzero(np.isnan(values) & (out == 0.0))
        if unwritten.size:
            raise ValueError(
                f"{self.name} does not write out[{unwritten[0]}] at the start; write every value, or give the right "
                "number k in (function, k)."
            )

    def written_beyond(self) -> ValueError:
        """Return the error of a function that writes beyond its values."""
        return ValueError(
            f"{self.name} writes beyond its {self.width} values; give the right number k in (function, k)."
        )
