"""The base classes of effects. An effect is a dataclass of parameters with compiled functions such as `force`."""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
from collections.abc import Collection, Mapping
from typing import Any, ClassVar, TypeAlias

import numba
import numpy as np
from numba.types import unliteral

from ..functions.checks import reals
from ..kernels.compile.jit import type_returned
from ..kernels.compile.numba_internals import Jitted, gist
from ..keywords import refuse_unknown
from .fields import annotations_of, check_fields

#: The functions of a `Body`, a `Link` or a `Cell` that cause accelerations.
FORCES = ("force", "acceleration", "tension", "force_density", "forces", "torque", "stress")
#: The function of the rate of a state that is a first-order unknown.
RATE = "state_rate"
#: The function of the angle between two bodies that is 0 if the torque does not jump from pi to -pi.
JUMPING = "jumping_angle"
#: The rules by which a link mixes the values of two points: see `Link`.
RULES = ("arithmetic", "geometric", "product")
#: The functions that change the state where the event of an effect occurs.
RESETS = ("velocity_after", "rate_after", "state_after")

Arrays: TypeAlias = list[np.ndarray]
Columns: TypeAlias = dict[str, np.ndarray]

_DRAWN = {"plane": ("normal", "offset"), "discs": ("contact_distance",)}  # the fields that a picture needs
REAL = (numba.types.Boolean, numba.types.Integer, numba.types.Float)
_OF_BODY = ("t", "x", "v", "m", "state")
_OF_LINK = ("t", "r", "rate", "state")
_ARRAY = numba.types.Array(numba.float64, 1, "C", readonly=True)


class Effect:
    """The base class of all effects.

    To define an effect, derive from `Body`, `Link`, `Motion` or a kind of `Cell`, and decorate the class with
    ``@dataclass(frozen=True, eq=False)``.

    The fields are the parameters. A field is a number, or an array with one number for each of the points, unless it is
    named in `vectors` or `arrays`. ``__post_init__`` computes a field with ``init=False``. A field must not have the
    name of an attribute of the base class, such as `source`.

    The functions are static methods compiled with ``eig3.jit``. The names of their arguments select what they read:
    fields, and the quantities that `Body`, `Link` or `Motion` offers. The scene computes only the quantities that are
    read.

    The event of an effect occurs where the value of the function ``event`` changes its sign. At the event,
    ``velocity_after`` of a `Body` returns the new velocity, ``rate_after`` of a `Link` the new rate of the distance,
    and ``state_after`` the new state, from the values before the event. A state is a number that every function of the
    effect can take as its argument `state`: it is 0 at the start and constant between events. Each point or pair has a
    separate event and state. With the class variable `state_size`, a state is a tuple of so many numbers.

    With ``state_rate``, which returns the time derivative of the state, the state is a first-order unknown: it is 0 at
    the start, and `solution.z` has it under the name of the effect. With ``state_after``, events change it too.

    Attributes
    ----------
    dimensions : tuple of int
        The dimensions of scenes that can have the effect.
    vectors : tuple of str
        The fields that hold a vector with a component for each dimension. The functions get a tuple.
    arrays : tuple of str
        The fields that hold one array of any length for all points, such as the samples of a record. The functions get
        a read-only one-dimensional array. Each effect with an array is compiled separately, so add one such effect to
        many points rather than many effects to one point each.
    nonnegative : tuple of str
        The fields that must not be negative. The constructor checks this.
    crossing : {-1, 0, 1}
        The changes of sign at which the event occurs: 1 from negative to positive only, -1 from positive to negative
        only, 0 both.
    at_start : str
        For a `crossing` that is not 0: what must hold at the start of a run, as "offset must be below each mass". A
        start at the event or behind it is then refused, because the event would not occur. Empty if it may be there.
        An impact that leads behind it causes the event too, if it changes the state alone.
    turns : bool
        Whether the event is a turn: only a start beyond yield with a velocity back is then refused. Without `at_start`,
        the link turns there.
    source : str
        The source of the formula in the literature.
    picture : str
        What animations draw: for a `Link` a "line", a "spring", a "string" until its state is no longer 0, "discs"
        around its ends that touch at the field contact_distance, or nothing for ""; for a `Body` a "plane" with the
        fields normal and offset, or nothing; for a `Cell` of three or four points the "surface" of its mesh, or
        nothing. "weight" draws one-dimensional scenes vertically.
    """

    dimensions: ClassVar[tuple[int, ...]] = (1, 2, 3)
    vectors: ClassVar[tuple[str, ...]] = ()
    arrays: ClassVar[tuple[str, ...]] = ()
    nonnegative: ClassVar[tuple[str, ...]] = ()
    crossing: ClassVar[int] = 0
    at_start: ClassVar[str] = ""
    turns: ClassVar[bool] = False
    source: ClassVar[str] = ""
    picture: ClassVar[str] = ""

    # the functions that this kind of effect can have, and the arguments that they can take
    offers: ClassVar[dict[str, tuple[str, ...]]] = {}
    needs: ClassVar[tuple[str, ...]] = ()  # an effect has at least one of these functions
    takes: ClassVar[tuple[int, ...]] = ()  # the possible numbers of arguments of points
    cutoff_field: ClassVar[str] = ""  # see `Link`
    state_size: ClassVar[int] = 1
    directions: ClassVar[int] = 1  # see `Link`
    needs_hinge: ClassVar[bool] = False  # whether it acts about the axis of a revolute joint in space

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_fields(cls, next(base for base in cls.__mro__[1:] if base.__module__ == __name__))

    def __new__(cls, *values: Any, **fields: Any) -> Any:
        # Without the decorator, Python would only complain about the number of arguments.
        known = getattr(cls, "__dataclass_fields__", None)
        if "__dataclass_fields__" not in vars(cls) and (known is None or annotations_of(cls).keys() - known):
            raise TypeError(f"{cls.__name__} must be a dataclass: decorate it with @dataclass(frozen=True, eq=False).")
        refuse_unknown(cls, fields)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Check the parameters. An effect with further checks calls this method first."""
        given = [field.name for field in dataclasses.fields(self) if field.init]  # type: ignore[arg-type]
        for name in set(self._read()) & set(given):
            self._reals(name)
        self._check_names("nonnegative")
        for name in self.nonnegative:
            self.require(self._reals(name) >= 0, f"{name} must not be negative")

    @property
    def title(self) -> str:
        """The name of the effect in errors and listings."""
        return type(self).__name__

    def parameters(self) -> list[str]:
        """Return the names of the fields, which the functions can take."""
        return [field.name for field in dataclasses.fields(self)]  # type: ignore[arg-type]

    def components(self, vector: str, dimension: int) -> int:
        """Return how many components a vector has in a scene of `dimension` dimensions."""
        return dimension

    def functions(self) -> dict[str, Any]:
        """Return the compiled functions that the effect has, by name."""
        found = {name: getattr(self, name, None) for name in self.offers}
        # a dispatcher in a class body without staticmethod is bound to the effect
        return {name: getattr(f, "__func__", f) for name, f in found.items() if f is not None}

    def reads_velocity(self) -> bool:
        """Return whether the accelerations that the effect causes depend on the velocities."""
        functions = self.functions()
        acting = [functions[name] for name in (*FORCES, "motion") if name in functions]
        read = {"v", "rate"} - {*self.parameters()}
        return RATE in functions or any(read & set(arguments(function)) for function in acting)

    def columns(self, shape: tuple[int, ...], dimension: int) -> Columns:
        """Return the parameters that the functions read, for points of a shape.

        Returns
        -------
        dict of str to ndarray
            Shape (points,), or (points, components) for a vector; the fields in `arrays` keep their length.

        Raises
        ------
        TypeError, ValueError
            If the parameters do not match the points. The error names the effect.
        """
        return {name: self._column(name, shape, dimension) for name in self._read()}

    def _read(self) -> list[str]:
        """Return the fields that the compiled functions read, a motion's direction, and a link's cutoff."""
        jitted = [function for function in self.functions().values() if isinstance(function, Jitted)]
        read = ["direction", self.cutoff_field, *(argument for function in jitted for argument in arguments(function))]
        return [name for name in self.parameters() if name in read]

    def _column(self, name: str, shape: tuple[int, ...], dimension: int) -> np.ndarray:
        values = self._values(name, dimension)
        if name in self.arrays:
            return values
        trailing = (self.components(name, dimension),) if name in self.vectors else ()
        try:
            return np.broadcast_to(values, shape + trailing).reshape(-1, *trailing)
        except ValueError:
            raise ValueError(
                f"{name} of {self.title} has the shape {values.shape}, which does not match points of shape {shape}; "
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
        """Return a copy that is independent of the lists and arrays that the caller passed."""
        fields = {name: getattr(self, name, None) for name in self.parameters()}
        copies = {name: copy.copy(value) for name, value in fields.items() if isinstance(value, list | np.ndarray)}
        if not copies:
            return self
        other = copy.copy(self)
        for name, value in copies.items():
            object.__setattr__(other, name, value)  # the record is frozen
        return other

    def check(self, dimension: int) -> None:
        """Check that a scene can compile the effect.

        Raises
        ------
        TypeError, ValueError
            If the scene cannot. The error names the effect.
        """
        for name in self.parameters():
            if not hasattr(self, name):
                raise TypeError(
                    f"{name} of {self.title} must be computed in __post_init__, because the field has init=False."
                )
        for what in ("vectors", "arrays"):
            self._check_names(what)
        if dimension not in self.dimensions:
            allowed = " or ".join(map(str, self.dimensions))
            raise ValueError(f"{self.title} needs a scene of {allowed} dimensions, not {dimension}.")
        functions = self.functions()
        if self.needs and not any(name in functions for name in self.needs):
            raise TypeError(f"{self.title} must have a function {' or '.join(self.needs)}.")
        for name, function in functions.items():
            if not isinstance(function, Jitted):
                what = f", and no field may have the name {name}" * (not callable(function))
                raise TypeError(f"{name} of {self.title} must be compiled: decorate it with @eig3.jit{what}.")
            taken = [field for field in self.parameters() if field in self.offers[name]]
            if taken:
                raise TypeError(f"{self.title} must rename its field {taken[0]}: {name} has an argument of this name.")
            offered = [*self.offers[name], *self.parameters()]
            unknown = [argument for argument in arguments(function) if argument not in offered]
            if unknown:
                raise TypeError(
                    f"{name} of {self.title} has the argument {unknown[0]}, but can take only {', '.join(offered)}."
                )
        self._check_event(functions)
        for name in _DRAWN.get(self.picture, ()):
            if name not in self._read():
                raise TypeError(
                    f"{self.title} must have a field {name} that a function reads, for its picture {self.picture!r}."
                )
        if self.cutoff_field and self.cutoff_field not in self.parameters():
            raise TypeError(f"cutoff_field of {self.title} must be the name of a field, not {self.cutoff_field!r}.")
        for name in self._read():
            self._values(name, dimension)
        for name, function in functions.items():
            self._compile(name, function, dimension)

    def _check_event(self, functions: dict[str, Any]) -> None:
        """Refuse a reset without an event, and a state that never changes."""
        if self.crossing not in (-1, 0, 1):
            raise ValueError(f"crossing of {self.title} must be -1, 0 or 1, not {self.crossing!r}.")
        resets = [name for name in RESETS if name in functions]
        if resets and "event" not in functions:
            raise TypeError(f"{self.title} must have a function event: {resets[0]} is called at its zeros.")
        reading = [name for name, function in functions.items() if "state" in arguments(function)]
        changing = [name for name in ("state_after", RATE) if name in functions]
        if reading and not changing:
            raise TypeError(
                f"{self.title} must have a function state_after or state_rate, because {reading[0]} reads the state."
            )

    def _check_names(self, what: str) -> None:
        """Check that a class variable is a tuple of names of fields that have a value."""
        names = getattr(self, what)
        if isinstance(names, str) or not isinstance(names, Collection):
            raise TypeError(f"{what} of {self.title} must be a tuple of names, not {names!r}.")
        known = [name for name in self.parameters() if hasattr(self, name)]
        for name in names:
            if name not in known:
                remedy = ", unless it is computed before super().__post_init__()" * (name in self.parameters())
                allowed = ", ".join(known) or "fields"
                raise TypeError(f"{what} of {self.title} can name only {allowed}, not {name!r}{remedy}.")

    def _compile(self, name: str, function: Any, dimension: int) -> None:
        """Compile a function for the arguments that a scene gives it, so that an error names the function."""
        given = self._argument_types(name, dimension)
        types = tuple(given.get(argument, numba.float64) for argument in arguments(function))
        try:
            returned = type_returned(function, types)
        except Exception as error:
            raise TypeError(f"{name} of {self.title} does not compile: {gist(error)}.") from error
        self._check_returned(name, returned, dimension)

    def _argument_types(self, name: str, dimension: int) -> dict[str, Any]:
        """Return the types of those arguments of a function that are not numbers."""
        sizes = {field: self.components(field, dimension) for field in self.vectors}
        sizes |= {argument: dimension for argument in ("x", "v") if argument in self.offers[name]}
        sizes |= {"state": self.state_size} if self.state_size > 1 else {}
        sizes |= dict.fromkeys(("r", "rate"), self.directions) if self.directions > 1 else {}
        given: dict[str, Any] = {x: numba.types.UniTuple(numba.float64, size) for x, size in sizes.items()}
        return given | dict.fromkeys(self.arrays, _ARRAY)

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        """Refuse a function that returns a wrong type."""
        vectors = dict.fromkeys(("force", "acceleration", "velocity_after"), dimension)
        of_state = dict.fromkeys(("state_after", RATE), self.state_size) if self.state_size > 1 else {}
        across = {"tension": self.directions} if self.directions > 1 else {}
        numbers = {**vectors, **of_state, **across, "motion": 2}.get(name)
        parts = [returned] if numbers is None else list(returned) if isinstance(returned, numba.types.BaseTuple) else []
        if len(parts) != (numbers or 1) or not all(isinstance(unliteral(part), REAL) for part in parts):
            wanted = "a number" if numbers is None else f"a tuple of {numbers} number{'s' * (numbers > 1)}"
            raise TypeError(f"{name} of {self.title} must return {wanted} here, not {unliteral(returned)}.")

    def shape_columns(self, rest: list[np.ndarray]) -> Columns:
        """Return columns that are computed from the positions at rest; see `Cell`."""
        return {}

    def resolved(self, points: tuple[Any, ...]) -> tuple[Effect, tuple[Any, ...]]:
        """Return the effect and its points for the arguments that the user gives, such as rigid bodies."""
        return self, points

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        """Check that the effect can act on these points.

        Parameters
        ----------
        masses : list of ndarray, shape (points,)
            For each argument of points; 0 for fixed points.
        positions : list of ndarray, shape (points, dimension)
        columns : dict of str to ndarray
            The parameters of these points.

        Raises
        ------
        ValueError
            If it cannot. The error names the effect.
        """

    def require(self, condition: Any, what: str) -> None:
        """Raise a ValueError if a condition on a field is false. `what` is the message, as "width must be positive"."""
        if not np.all(condition):
            raise ValueError(f"{self._said(what)}.")

    @property
    def rule(self) -> str:
        """What must hold at the start of a run, with the name of the effect."""
        return self._said(self.at_start)

    def _said(self, what: str) -> str:
        name, _, rest = what.partition(" ")
        return f"{name} of {self.title} {rest}" if what else ""

    def require_unit(self, vector: str) -> None:
        """Raise a ValueError if a field contains a vector that is not a unit vector."""
        length = np.linalg.norm(np.atleast_1d(self._reals(vector)), axis=-1)
        self.require(np.abs(length - 1) < 1e-9, f"{vector} must be a unit vector")

    def _reals(self, name: str) -> np.ndarray:
        values = reals(getattr(self, name), f"{name} of {self.title}")
        self.require(np.isfinite(values), f"{name} must be finite")
        return values


class Body(Effect):
    """An effect on single masses.

    A class has ``force`` or ``acceleration``, which return a tuple with a component for each dimension. It may have
    ``potential``, an energy; the force is then minus its gradient. Their arguments can be the time t, the position x
    and velocity v as tuples, the mass m, and fields. `vectors`, `arrays` and `nonnegative` name special fields::

        @dataclass(frozen=True, eq=False)
        class SampledForce(Body):
            samples: ArrayLike  # N, of any length
            interval: float  # s
            direction: ArrayLike

            vectors = ("direction",)
            arrays = ("samples",)
            nonnegative = ("interval",)

            @staticmethod
            @eig3.jit
            def force(t, samples, interval, direction):
                f = samples[min(int(t / interval), samples.size - 1)]
                return f * direction[0], f * direction[1]

    The functions ``event``, ``velocity_after``, ``state_after`` and ``state_rate`` can take the same arguments as a
    force: see `Effect`.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        **dict.fromkeys(("force", "acceleration", "event", "velocity_after", "state_after", RATE), _OF_BODY),
        "potential": ("x", "m", "state"),
    }
    needs: ClassVar[tuple[str, ...]] = ("force", "acceleration", "event")
    takes: ClassVar[tuple[int, ...]] = (0, 1)

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        if any((m == 0).any() for m in masses):
            raise ValueError(f"{self.title} acts on masses, but was given fixed points.")


class Link(Effect):
    """An effect between two points, along the line through them.

    A class has ``tension``, the attractive force between the points, or ``force_density``, the tension divided by the
    distance. It may have ``potential``, an energy; the tension is then its derivative with respect to the distance.
    Their arguments can be the time t, the distance r, its time derivative rate, and fields; see `Body` for `vectors`,
    `arrays` and `nonnegative`. In one dimension the r of a link between two given points has a sign: it is positive
    while the points are in the same order as at the start, and negative after they have passed each other. For pair
    forces, and in a periodic box, r is the distance.

    The functions ``event``, ``rate_after``, ``state_after`` and ``state_rate`` can take the same arguments as a
    tension: see `Effect`. The scene applies opposite impulses to the two ends, which conserve the momentum and produce
    the new rate.

    If a link has a field ``rest_length`` that is not 0, its points must not coincide at the start.

    A link with two `directions` acts across two directions of a structure at once, such as an isolator in the plane.
    Then r, rate and the tension are tuples of two.

    Attributes
    ----------
    directions : int
        1, or 2 for a link of structures across two directions.
    cutoff_field : str
        The name of the field with the distance beyond which all functions of the link are 0. Pairs beyond it are
        skipped before their distance is computed, which makes contacts between many pairs fast. Empty for links without
        a cutoff.
    ductility : jitted function, optional
        The size of the stretch relative to the stretch at yield, from r and fields that other functions read, for
        `eig3.structures.link_ductility`.
    mixed : tuple of str, or dict of str to str
        The fields that can have a value for each point of a pair force: see `Scene.add`. A dictionary also has the rule
        for the value of a pair: "arithmetic", the mean of the values of its points, which is the rule of a tuple;
        "geometric", the root of their product; or "product".
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        **dict.fromkeys(("tension", "force_density", "event", "rate_after", "state_after", RATE), _OF_LINK),
        "potential": ("r", "state"),
    }
    needs: ClassVar[tuple[str, ...]] = ("tension", "force_density", "event")
    takes: ClassVar[tuple[int, ...]] = (2,)
    mixed: ClassVar[tuple[str, ...] | Mapping[str, str]] = ()
    picture: ClassVar[str] = "line"
    ductility: ClassVar[Any] = None

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        if ((masses[0] == 0) & (masses[1] == 0)).any():
            raise ValueError(f"{self.title} joins two fixed points, which cannot move: give a mass as one end.")
        for name in {"rest_length", self.cutoff_field} & set(columns):
            self.require(columns[name] >= 0, f"{name} must not be negative")
        if (self.needs_direction(columns) & (positions[0] == positions[1]).all(axis=-1)).any():
            raise ValueError(
                f"{self.title} has no direction where its ends coincide at the start: put them apart, or "
                "take a spring without a rest length."
            )

    def check(self, dimension: int) -> None:
        super().check(dimension)
        rules = self.mixing_rules()
        for name, rule in rules.items():
            if rule not in RULES:
                raise ValueError(f"mixed of {self.title} has the rule {rule!r} of {name}; take {', '.join(RULES)}.")
        if rules.get(self.cutoff_field, "arithmetic") != "arithmetic":
            raise ValueError(f"mixed of {self.title} must have the rule 'arithmetic' of its cutoff.")

    def mixing_rules(self) -> dict[str, str]:
        """Return the rule of each field in `mixed`."""
        return dict(self.mixed) if isinstance(self.mixed, Mapping) else dict.fromkeys(self.mixed, "arithmetic")

    def of_groups(self, groups: int) -> Any:
        """Return the link between all near points of one group, or of two."""
        return self

    def check_group(self, pair_force: Any, cloud: Any) -> None:
        """Check that the link can act between the points of a pair force.

        Raises
        ------
        ValueError
            If it cannot. The error names the effect.
        """

    def self_energy(self, columns: Columns) -> float:
        """Return the part of the energy of a group that does not depend on the places of its points, J."""
        return 0.0

    def needs_direction(self, columns: Columns) -> Any:
        """Return for each pair whether its points must not coincide at the start."""
        return columns.get("rest_length", np.zeros(1)) != 0


def distance(positions: list[np.ndarray]) -> np.ndarray:
    """Return the distance of each pair of points."""
    return np.linalg.norm(positions[1] - positions[0], axis=-1)


class Motion(Effect):
    """A prescribed motion of fixed points along a direction.

    A class has ``motion``, which returns the displacement from the fixed position and its rate, and a vector field
    ``direction``, which multiplies both. The arguments can be the time t and fields; see `Body` for `vectors`, `arrays`
    and `nonnegative`. Several motions of one point add up.
    """

    _record: ClassVar[tuple[str, ...]] = ()  # the arrays with the times and the values of a record, see `Source`
    offers: ClassVar[dict[str, tuple[str, ...]]] = {"motion": ("t",)}
    needs: ClassVar[tuple[str, ...]] = ("motion",)
    takes: ClassVar[tuple[int, ...]] = (1,)

    def columns(self, shape: tuple[int, ...], dimension: int) -> Columns:
        for name in (name for name in self._read() if name not in self.arrays):
            if self._values(name, dimension).ndim > (name in self.vectors):
                raise ValueError(f"{name} of {self.title} is the same for all points: add a motion for each point.")
        return super().columns((), dimension)

    def check(self, dimension: int) -> None:
        super().check(dimension)
        if "direction" not in self.vectors or not hasattr(self, "direction"):
            raise TypeError(f'{self.title} must have a field direction, and vectors = ("direction",).')

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        if (masses[0] > 0).any():
            raise ValueError(f"{self.title} moves fixed points, but was given masses, which forces move.")


@functools.lru_cache(maxsize=256)
def arguments(function: Any) -> tuple[str, ...]:
    """Return the names of a compiled function's arguments."""
    return tuple(inspect.signature(function.py_func).parameters)
