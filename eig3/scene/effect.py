"""What an effect of a scene is: a record of its parameters, and compiled functions named by what they give."""

from __future__ import annotations

import copy
import dataclasses
import inspect
from typing import Any, ClassVar

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.types import unliteral

from ..callbacks import gist
from ..checks import reals

_REAL = (numba.types.Boolean, numba.types.Integer, numba.types.Float)
_ARRAY = numba.types.Array(numba.float64, 1, "C", readonly=True)


class Effect:
    """What every effect's class tells. Derive from `Body`, `Link` or `Motion`, as a dataclass with eq=False.

    The fields are the parameters: numbers, or one for each of the points, unless they are named in `vectors` or
    `arrays`. The functions, compiled with ``eig3.jit`` and written as static methods, take those fields that they name
    as arguments, beside what their kind of effect offers. One that does not name the velocity does not read it, and
    nothing computes it.

    Attributes
    ----------
    dimensions : tuple of int
        Those of the scenes that the effect can be in.
    vectors : tuple of str
        The fields that hold a vector, with a component for each dimension; the functions get a tuple.
    arrays : tuple of str
        The fields that hold an array of any length; the functions get it as an array that they may only read. Every
        effect with an array of its own is code of its own: let one act on many points rather than many on one each.
    source : str
        Where the formula comes from.
    """

    dimensions: ClassVar[tuple[int, ...]] = (1, 2, 3)
    vectors: ClassVar[tuple[str, ...]] = ()
    arrays: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = ""

    offers: ClassVar[dict[str, tuple[str, ...]]] = {}  # the functions of a kind of effect, and what each can be given
    needs: ClassVar[tuple[str, ...]] = ()  # one of these
    takes: ClassVar[tuple[int, ...]] = ()  # how many arguments of points

    @property
    def title(self) -> str:
        """What errors and listings call it."""
        return type(self).__name__

    def components(self, vector: str, dimension: int) -> int:
        """How many components a vector has in a scene of `dimension` dimensions."""
        return dimension

    def functions(self) -> dict[str, Any]:
        """The compiled functions that the effect has, by name."""
        found = {name: getattr(self, name, None) for name in self.offers}
        # a dispatcher that stands in a class without staticmethod has bound itself
        return {name: getattr(f, "__func__", f) for name, f in found.items() if f is not None}

    def reads_velocity(self) -> bool:
        """Whether what the effect adds to the accelerations depends on the velocities."""
        functions = self.functions()
        return any({"v", "rate"} & set(arguments(functions[name])) for name in functions if name != "potential")

    def columns(self, shape: tuple[int, ...], dimension: int) -> dict[str, np.ndarray]:
        """The parameters that the functions read, for points of that shape.

        Returns
        -------
        dict of str to ndarray
            Shape (points,), or (points, components) for a vector; an array is as it is.

        Raises
        ------
        TypeError, ValueError
            In a sentence that names the effect.
        """
        return {name: self._column(name, shape, dimension) for name in self._read()}

    def _read(self) -> list[str]:
        """The fields that the functions read, and a motion's direction."""
        read = {"direction", *(argument for function in self.functions().values() for argument in arguments(function))}
        return [name for name in _fields(self) if name in read]

    def _column(self, name: str, shape: tuple[int, ...], dimension: int) -> np.ndarray:
        values = self._values(name, dimension)
        if name in self.arrays:
            return values
        trailing = (self.components(name, dimension),) if name in self.vectors else ()
        try:
            return np.broadcast_to(values, shape + trailing).reshape(-1, *trailing)
        except ValueError:
            raise ValueError(
                f"{name} of {self.title} has the shape {values.shape}, which does not go with points of shape {shape}; "
                f"if it is a vector or an array, name it in the class's vectors or arrays."
            ) from None

    def _values(self, name: str, dimension: int) -> np.ndarray:
        values = self._reals(name)
        if name in self.vectors:
            components = self.components(name, dimension)
            values = values.reshape(1) if values.ndim == 0 and components == 1 else values
            if values.shape[-1:] != (components,):
                given = f"{values.shape[-1]}" if values.ndim else "a number"
                raise ValueError(f"{name} of {self.title} must have {components} components, not {given}.")
        return values

    def snapshot(self) -> Any:
        """The effect as it is now: its own copy of lists and arrays, which the caller may change."""
        fields = {name: getattr(self, name) for name in _fields(self)}
        copies = {name: copy.copy(value) for name, value in fields.items() if isinstance(value, list | np.ndarray)}
        return dataclasses.replace(self, **copies) if copies else self  # type: ignore[type-var]

    def check(self, dimension: int) -> None:
        """Refuse what cannot be compiled, in a sentence that names the effect.

        Raises
        ------
        TypeError, ValueError
        """
        if not dataclasses.is_dataclass(self):
            raise TypeError(f"{self.title} must be a dataclass: decorate it with @dataclass(frozen=True, eq=False).")
        for name in ("vectors", "arrays"):
            if isinstance(getattr(self, name), str):
                raise TypeError(f"{name} of {self.title} must be a tuple of names, not a string.")
        if dimension not in self.dimensions:
            allowed = " or ".join(map(str, self.dimensions))
            raise ValueError(f"{self.title} needs a scene of {allowed} dimensions, not {dimension}.")
        functions = self.functions()
        if not any(name in functions for name in self.needs):
            raise TypeError(f"{self.title} must have a function {' or '.join(self.needs)}.")
        for name, function in functions.items():
            if not isinstance(function, Dispatcher):
                what = ", and the name is not for a number" * (not callable(function))
                raise TypeError(f"{name} of {self.title} must be compiled: decorate it with @eig3.jit{what}.")
            taken = [field for field in _fields(self) if field in self.offers[name]]
            if taken:
                raise TypeError(f"{self.title} must not call a field {taken[0]}, which is what {name} is given.")
            offered = [*self.offers[name], *_fields(self)]
            unknown = [argument for argument in arguments(function) if argument not in offered]
            if unknown:
                raise TypeError(
                    f"{name} of {self.title} names {unknown[0]}, but can be given only {', '.join(offered)}."
                )
        for name in self._read():
            self._values(name, dimension)
        for name, function in functions.items():
            self._compile(name, function, dimension)

    def _compile(self, name: str, function: Any, dimension: int) -> None:
        """Compile a function for what a scene gives it: an error of its own is told here, not in the scene's code."""
        sizes = {field: self.components(field, dimension) for field in self.vectors}
        sizes |= {argument: dimension for argument in ("x", "v") if argument in self.offers[name]}
        given: dict[str, Any] = {x: numba.types.UniTuple(numba.float64, size) for x, size in sizes.items()}
        given |= dict.fromkeys(self.arrays, _ARRAY)
        types = tuple(given.get(argument, numba.float64) for argument in arguments(function))
        try:
            function.compile(types)
            returned = function.overloads[types].signature.return_type
        except Exception as error:
            raise TypeError(f"{name} of {self.title} does not compile: {gist(error)}.") from error
        numbers = {"force": dimension, "acceleration": dimension, "motion": 2}.get(name)
        parts = [returned] if numbers is None else list(returned) if isinstance(returned, numba.types.BaseTuple) else []
        if len(parts) != (numbers or 1) or not all(isinstance(unliteral(part), _REAL) for part in parts):
            wanted = "a number" if numbers is None else f"a tuple of {numbers} number{'s' * (numbers > 1)}"
            raise TypeError(f"{name} of {self.title} must return {wanted} here, not {unliteral(returned)}.")

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
        """Refuse points that the effect cannot act on, in a sentence that names it.

        Parameters
        ----------
        masses : list of ndarray, shape (points,)
            For each argument of points; 0 for those that are fixed.
        positions : list of ndarray, shape (points, dimension)
        columns : dict of str to ndarray
            The parameters of these points.

        Raises
        ------
        ValueError
        """

    def require(self, condition: Any, what: str) -> None:
        """For an effect's own __post_init__: a ValueError where not all is true, such as "length must be positive"."""
        if not np.all(condition):
            name, _, rest = what.partition(" ")
            raise ValueError(f"{name} of {self.title} {rest}.")

    def require_unit(self, vector: str) -> None:
        """The same for a field that must hold unit vectors."""
        length = np.linalg.norm(np.atleast_1d(self._reals(vector)), axis=-1)
        self.require(np.abs(length - 1) < 1e-9, f"{vector} must be a unit vector")

    def _reals(self, name: str) -> np.ndarray:
        values = reals(getattr(self, name), f"{name} of {self.title}")
        self.require(np.isfinite(values), f"{name} must be finite")
        return values


class Body(Effect):
    """What acts on masses, one by one.

    A class has ``force`` or ``acceleration``, which return a tuple with a component for each dimension, and may have
    ``potential``, which returns the energy of which the force is minus the gradient. They can be given the time t, the
    position x and velocity v as such tuples, and the mass m.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        "force": ("t", "x", "v", "m"),
        "acceleration": ("t", "x", "v", "m"),
        "potential": ("x", "m"),
    }
    needs: ClassVar[tuple[str, ...]] = ("force", "acceleration")
    takes: ClassVar[tuple[int, ...]] = (0, 1)

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
        if any((m == 0).any() for m in masses):
            raise ValueError(f"{self.title} acts on masses, but was given fixed points.")


class Link(Effect):
    """What acts between two points along the line through them.

    A class has ``tension``, the force that pulls the points together, or ``density``, that force divided by the
    distance; and may have ``potential``, of which the tension is the derivative by the distance. They can be given the
    time t, the distance r and the rate at which it grows, rate. In one dimension r has a sign: the two points are in
    order as long as they are in the order of the start, and where they have passed through each other r is negative.

    A field of the name ``length`` is a natural length: where it is not 0 the points must not coincide at the start.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        "tension": ("t", "r", "rate"),
        "density": ("t", "r", "rate"),
        "potential": ("r",),
    }
    needs: ClassVar[tuple[str, ...]] = ("tension", "density")
    takes: ClassVar[tuple[int, ...]] = (2,)

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
        if ((masses[0] == 0) & (masses[1] == 0)).any():
            raise ValueError(f"{self.title} stands between two fixed points, where it moves nothing.")
        self.require(columns.get("length", 0.0) >= 0, "length must not be negative")
        if (self.needs_direction(columns) & (positions[0] == positions[1]).all(axis=-1)).any():
            raise ValueError(
                f"{self.title} has no direction where its ends coincide at the start: put them apart, or "
                "take a spring without a natural length."
            )

    def needs_direction(self, columns: dict[str, np.ndarray]) -> Any:
        """Whether the two points must not coincide at the start; of each pair."""
        return columns.get("length", np.zeros(1)) != 0


class Motion(Effect):
    """How fixed points move, along a direction.

    A class has ``motion``, which returns the displacement from where the point was fixed and its rate, and a vector
    field ``direction``, by which the two are multiplied. It can be given the time t. Motions of one point add up.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"motion": ("t",)}
    needs: ClassVar[tuple[str, ...]] = ("motion",)
    takes: ClassVar[tuple[int, ...]] = (1,)

    def columns(self, shape: tuple[int, ...], dimension: int) -> dict[str, np.ndarray]:
        return super().columns((), dimension)  # one motion, whatever it moves

    def check(self, dimension: int) -> None:
        super().check(dimension)
        if "direction" not in self.vectors or not hasattr(self, "direction"):
            raise TypeError(f'{self.title} must have a field direction, and vectors = ("direction",).')

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
        if (masses[0] > 0).any():
            raise ValueError(f"{self.title} moves fixed points, but was given masses, which move by their forces.")


def arguments(function: Any) -> tuple[str, ...]:
    """The names of a compiled function's arguments."""
    return tuple(inspect.signature(function.py_func).parameters)


def _fields(effect: Effect) -> list[str]:
    return [field.name for field in dataclasses.fields(effect)]  # type: ignore[arg-type]
