"""Records of the methods: the name, order, cost and options of each method, and the kernel that runs it."""

import dataclasses
import difflib
import functools
import math
import numbers
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from .kernels.loops.formulas import Formulas, formulas
from .keywords import refuse_unknown

#: Largest number of degrees of freedom n for which "auto" changes to Newton's method, whose differences need n + 1 #:
#: evaluations in each iteration.
_MOST_DIFFERENCES = 64

_LARGEST = sys.float_info.max
_LARGEST_COUNT = 2**53  # all whole numbers up to this are floats

#: The class of every method, by its short name. A class is added here when it is defined.
METHODS: dict[str, Any] = {}


class Method:
    """Base class of the records. A record describes a method and holds its options.

    A subclass that defines `name` is added to `METHODS`. `eig3.integrate` then accepts this name, and the label, as its
    `method`.

    Attributes
    ----------
    name : str
        The short name. As a `method`, it selects the method with default options.
    label : str
        The name in tables and pictures.
    order : int
        The order of convergence.
    kernel : str
        The name of the module that holds the formulas. `eig3.kernels` describes what such a module contains.
    member : tuple
        For a family of methods, the arguments of the module's function `member`, which returns the formulas of a
        member.
    variable : str
        The name of the file of kernels with the formulas for steps of variable length; empty if there are none.
    ignores_velocity : bool
        Whether the method is valid only for a right-hand side that does not depend on the velocity.
    is_stochastic : bool
        Whether the steps add random numbers. The commands and `eig3.plan` do not compare such a method with others.
    jacobian : jitted function or None
        df/dv, for a method that can use it.
    takes_constraints : bool
        Whether the method supports scenes with constraints.
    second : str
        The kind of the second callback, if it is not a jacobian.

    Raises
    ------
    ValueError
        If another method already has the name; raised when the subclass is defined.
    AttributeError
        If an option is assigned: subclasses are frozen dataclasses.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    order: ClassVar[int]
    kernel: ClassVar[str]
    member: ClassVar[tuple] = ()
    variable: ClassVar[str] = ""
    ignores_velocity: ClassVar[bool] = False
    is_stochastic: ClassVar[bool] = False
    jacobian: Callable | None = None
    takes_constraints: ClassVar[bool] = True
    second: ClassVar[str] = ""

    def __new__(cls, *values: Any, **fields: Any) -> Any:
        if fields:
            refuse_unknown(cls, fields)
        return super().__new__(cls)

    def __init_subclass__(cls) -> None:
        if not isinstance(vars(cls).get("name"), str):
            return  # a variant of another record, or a family of methods
        name = cls.name.lower()
        known = METHODS.get(name)
        # A notebook may run the same definition twice, but two different methods must not share a name.
        if known and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"name {name!r} is taken by {known.__qualname__}; give {cls.__qualname__} another name.")
        METHODS[name] = cls

    def __setattr__(self, name: str, value: Any) -> None:
        kind = type(self).__name__  # runs are remembered by their options
        raise AttributeError(f"{kind} cannot set {name!r}: write the options as fields of a @dataclass(frozen=True).")

    @property
    def evaluations(self) -> int | None:
        """Evaluations of the right-hand side per step, from the kernel; None if an iteration decides."""
        return self.formulas.evaluations

    @property
    def is_implicit(self) -> bool:
        """Whether each step solves an equation by iteration. The number of evaluations then varies between steps."""
        return self.evaluations is None

    @functools.cached_property
    def settings(self) -> tuple[float, ...]:
        """The options that the kernel needs: by default, the fields of the record that are numbers, in their order."""
        values = [getattr(self, name) for name in getattr(self, "__dataclass_fields__", ())]
        return tuple([float(x) for x in values if isinstance(x, int | float | np.number)])

    def settings_of(self, members: Sequence[int]) -> tuple[float, ...]:
        """Return the settings for a block of members of an ensemble, with their numbers."""
        return self.settings

    def of_member(self, member: int) -> "Method":
        """Return the method for the member of an ensemble with this number."""
        return self

    def for_masses(self, masses: "np.ndarray", owner: str) -> "Method":
        """Return the method for degrees of freedom with these masses of the problem `owner`."""
        return self

    def without_noise(self) -> "Method":
        """Return the deterministic method with the same stability limit."""
        return self

    def for_force(self, reads_velocity: bool, n: int) -> "Method":
        """Return the method for n degrees of freedom, with every option "auto" decided."""
        return self

    def with_constraints(self) -> "Method":
        """Return the method for a right-hand side with constraints.

        By default the steps are the same: the accelerations include the reactions, and the state is projected after
        each step.

        Raises
        ------
        ValueError
            If the method does not support constraints.
        """
        if not self.takes_constraints:
            raise ValueError(f"method {self.name!r} does not support constraints: take another method, such as 'eig3'.")
        return self

    def fallback(self, n: int) -> "Method | None":
        """Return the method to use after the solve of a step has not converged; None if there is none."""
        return None

    def without_velocity(self) -> "Method":
        """Return the best variant of this method for a force that does not depend on the velocity."""
        return self

    @property
    def formulas(self) -> Formulas:
        """The formulas of the kernel. Their module is imported on first access."""
        return formulas(self.kernel, self.member)


class _MayIgnoreVelocity(Method):
    """Base class of the records with the option `velocity`: "none" saves work if the force ignores the velocity."""

    velocity: str

    @property
    def ignores_velocity(self) -> bool:  # type: ignore[override]
        return self.velocity == "none"

    def for_force(self, reads_velocity: bool, n: int) -> Method:
        return self.without_velocity() if self.velocity == "auto" and not reads_velocity else self

    def without_velocity(self) -> Method:
        return dataclasses.replace(self, velocity="none")  # type: ignore[type-var]

    def _check_velocity(self) -> None:
        if self.velocity not in ("auto", "explicit", "none"):
            raise ValueError(f"velocity must be 'auto', 'explicit' or 'none', not {self.velocity!r}.")


@dataclass(frozen=True)
class EIG3(_MayIgnoreVelocity):
    """EIG-3, the explicit integration method of grade 3: one evaluation per step, explicit for every force.

    Parameters
    ----------
    alpha, beta : float
        Weights of a_n - a_{n-1} in the displacement and in the velocity. The order is 2 if beta is 1/2, and 1
        otherwise. For an undamped oscillator of frequency omega, the set (1, 1/2) has no numerical damping and, of all
        second-order sets, the largest stable step, h < 2 / omega. With beta = 1/2, a larger alpha damps the high
        frequencies numerically, and a smaller alpha makes every step unstable without physical damping.
    velocity : {"auto", "explicit", "none"}
        "explicit" allows any force. "none" is for a force that does not depend on the velocity: the set (1, 1/2) then
        computes the same u and v, but reads and writes fewer arrays; a force whose value at the start depends on the
        velocity raises an error. "auto" chooses "none" if the code of the right-hand side never uses its argument v,
        and "explicit" otherwise.

    Raises
    ------
    ValueError
        If alpha or beta is not a finite number, or velocity is not one of the three names.
    """

    alpha: float = 1.0
    beta: float = 0.5
    velocity: str = field(default="auto", repr=False)
    name: ClassVar[str] = "eig3"
    label: ClassVar[str] = "EIG-3"

    def __post_init__(self) -> None:
        for name, value in (("alpha", self.alpha), ("beta", self.beta)):
            if not (isinstance(value, numbers.Real) and -_LARGEST <= value <= _LARGEST):
                raise ValueError(f"{name} must be a finite number, not {shown(value)}.")
        self._check_velocity()

    @property
    def kernel(self) -> str:  # type: ignore[override]
        staggered = self.ignores_velocity and self.settings == (1.0, 0.5)
        return "eig3.kernels.methods.eig3_staggered" if staggered else "eig3.kernels.methods.eig3"

    @property
    def variable(self) -> str:  # type: ignore[override]
        return "eig3_variable" if self.settings == (1.0, 0.5) else ""

    def with_constraints(self) -> Method:
        explicit = dataclasses.replace(self, velocity="explicit")
        return _EIG3WithConstraints() if self.settings == (1.0, 0.5) else explicit

    @property
    def order(self) -> int:  # type: ignore[override]
        return 2 if self.beta == 0.5 else 1


@dataclass(frozen=True)
class _EIG3WithConstraints(EIG3):
    """EIG-3 (1, 1/2) with accelerations without reactions, and multipliers that enforce the constraints."""

    second: ClassVar[str] = "constrained_step"

    @property
    def kernel(self) -> str:  # type: ignore[override]
        return "eig3.kernels.methods.eig3_constrained"


@dataclass(frozen=True, repr=False)
class CentralDifference(_MayIgnoreVelocity):
    """Central difference, the classical explicit method of structural dynamics; implicit if f depends on velocity.

    Parameters
    ----------
    velocity : {"auto", "implicit", "none", "lagged"}
        "implicit" solves v = w + h/2 f(t, u, v) at every step, where w is the velocity half a step earlier. It has
        second order for every force. "none" is for a force that does not depend on the velocity: it takes one
        evaluation per step and no solve; a force whose value at the start depends on the velocity raises an error.
        "auto" chooses "none" if the code of the right-hand side never uses its argument v, and "implicit" otherwise.
        "lagged" passes w to f instead of v: it is explicit, but only of first order. Use it only for comparisons.
    solver : {"auto", "newton", "fixed-point"}
        The solver of "implicit" for v. Newton's method also converges if h df/dv is large. Fixed-point iteration is
        cheaper if h df/dv is small. "auto" uses Newton's method if there is a jacobian. Otherwise it starts with
        fixed-point iteration, and changes to Newton's method for the rest of the run at the first step in which the
        iteration does not converge, or needs more evaluations than Newton's method would. With more than 64 degrees of
        freedom it does not change.
    jacobian : jitted function, optional
        df/dv for Newton's method. For n degrees of freedom, ``jacobian(t, u, v, p, J)`` writes the entries of the
        n x n array J that are not zero; J is zero before each call. For one degree of freedom,
        ``jacobian(t, u, v, p)`` returns a float. Without a jacobian, differences of f approximate df/dv.
    tol : float
        Relative tolerance of v. The iteration ends when the residual of v is at most tol (|v| + |w|), where the
        residual, |v| and |w| are summed over the degrees of freedom. It also ends when the residual no longer decreases
        and changes u by less than the round-off of u. A degree of freedom much smaller than the others gets a larger
        relative error: scale the unknowns if their units differ.
    max_iterations : int
        Largest number of iterations in one step. If a step needs more, the run ends with the status NOT_CONVERGED.

    Raises
    ------
    ValueError
        If an option is not valid, or if a jacobian is given that would not be used.
    """

    velocity: str = "auto"
    solver: str = "auto"
    jacobian: Callable | None = None
    tol: float = 1e-12
    max_iterations: int = 50
    takes_constraints: ClassVar[bool] = False
    name: ClassVar[str] = "cd"
    label: ClassVar[str] = "CD"

    def __post_init__(self) -> None:
        if self.velocity not in ("auto", "implicit", "none", "lagged"):
            raise ValueError(f"velocity must be 'auto', 'implicit', 'none' or 'lagged', not {self.velocity!r}.")
        if self.solver not in ("auto", "newton", "fixed-point"):
            raise ValueError(f"solver must be 'auto', 'newton' or 'fixed-point', not {self.solver!r}.")
        if self.jacobian is not None and not (self.is_implicit and self.solver != "fixed-point"):
            raise ValueError(
                "jacobian is used by Newton's method only; leave it out, or take velocity='implicit', solver='newton'."
            )
        if not (isinstance(self.tol, numbers.Real) and 0 < self.tol < 1):
            raise ValueError(f"tol must be a number between 0 and 1, not {shown(self.tol)}.")
        if not (isinstance(self.max_iterations, numbers.Integral) and 1 <= self.max_iterations <= _LARGEST):
            raise ValueError(f"max_iterations must be a whole number of at least 1, not {shown(self.max_iterations)}.")

    def __repr__(self) -> str:
        changed = [f for f in dataclasses.fields(self) if getattr(self, f.name) != f.default]
        return f"CentralDifference({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in changed)})"

    @property
    def kernel(self) -> str:  # type: ignore[override]
        if not self.is_implicit:
            return "eig3.kernels.methods.cd"
        newton = self.solver == "newton" or self.jacobian is not None
        return "eig3.kernels.methods.cd_newton" if newton else "eig3.kernels.methods.cd_fixed_point"

    @property
    def order(self) -> int:  # type: ignore[override]
        return 1 if self.velocity == "lagged" else 2

    @property
    def evaluations(self) -> int | None:
        return None if self.velocity in ("auto", "implicit") else 1

    def for_force(self, reads_velocity: bool, n: int) -> Method:
        if self.velocity == "auto" and not reads_velocity:
            return self.without_velocity()
        if not self._solver_is_open:
            return self
        # A step by Newton's method with differences takes about 2 n + 3 evaluations. Fixed-point iteration takes one #
        # evaluation per iteration, and stops paying at about twice this number.
        return dataclasses.replace(self, solver="fixed-point", max_iterations=min(self.max_iterations, 8 + 4 * n))

    def fallback(self, n: int) -> Method | None:
        return dataclasses.replace(self, solver="newton") if self._solver_is_open and n <= _MOST_DIFFERENCES else None

    @property
    def _solver_is_open(self) -> bool:
        return self.is_implicit and self.solver == "auto" and self.jacobian is None

    def without_velocity(self) -> Method:
        return dataclasses.replace(self, velocity="none", jacobian=None)


class _NamedAsClass(Method):
    """Base class of the methods without options. Name, label and kernel have the name of the class."""

    def __init_subclass__(cls, **facts: Any) -> None:
        if facts:  # a subclass of RK4 inherits these
            cls.name, cls.label = cls.__name__.lower(), cls.__name__
            cls.kernel = f"eig3.kernels.methods.{cls.name}"
            for name, value in facts.items():
                setattr(cls, name, value)
            dataclass(frozen=True)(cls)
        super().__init_subclass__()


class RK2(_NamedAsClass, order=2):
    """RK2, Heun's method, which the article uses: two evaluations per step; unstable at every step without damping."""


class RK3(_NamedAsClass, order=3):
    """RK3, Kutta's third-order method: three evaluations per step; stable up to omega h = sqrt 3 without damping."""


class RK4(_NamedAsClass, order=4):
    """RK4, the classical Runge-Kutta method: four evaluations per step; stable up to omega h = 2 sqrt 2 undamped."""


class AB2(_NamedAsClass, order=2):
    """AB2, Adams-Bashforth of second order: one evaluation per step; unstable at every step without damping."""


class AB3(_NamedAsClass, order=3):
    """AB3, Adams-Bashforth of third order: one evaluation per step; stable up to omega h = 0.7236 without damping."""


class RK5(_NamedAsClass, order=5, variable="rk5"):
    """RK5, the fifth-order formula of Tsitouras' pair 5(4), with six evaluations per step."""


class RK8(_NamedAsClass, order=8, variable="rk8"):
    """RK8, the eighth-order formula of Dormand and Prince's DOP853, with twelve evaluations per step."""


class RKN12(_NamedAsClass, order=12, variable="rkn12", ignores_velocity=True):
    """RKN12, Dormand, El-Mikkawy and Prince's method of order 12, with 17 evaluations per step, for f(t, u)."""


class BM6(_NamedAsClass, order=6, ignores_velocity=True):
    """BM6, Blanes and Moan's symplectic method of order 6, with eleven evaluations per step, for f(t, u)."""


@dataclass(frozen=True)
class EIG(_MayIgnoreVelocity):
    """The EIG method of a grade: one evaluation per step, of the order grade - 1.

    Parameters
    ----------
    grade : int
        From 3 to 13. Grade 3 computes the same u as ``EIG3()``; v is synchronised with u.
    velocity : {"auto", "explicit", "none"}
        As for `EIG3`: "none" is for a force that does not depend on the velocity, and skips its prediction.

    Raises
    ------
    ValueError
        If the grade is not a whole number from 3 to 13, or velocity is not one of the three names.
    """

    grade: int
    velocity: str = field(default="auto", repr=False)
    kernel: ClassVar[str] = "eig3.kernels.methods.eig"

    def __post_init__(self) -> None:
        is_whole = isinstance(self.grade, numbers.Integral) and not isinstance(self.grade, bool)
        if not (is_whole and 3 <= self.grade <= 13):
            raise ValueError(f"grade must be a whole number from 3 to 13, not {shown(self.grade)}.")
        self._check_velocity()

    @property
    def name(self) -> str:  # type: ignore[override]
        return f"eig{self.grade}"

    @property
    def label(self) -> str:  # type: ignore[override]
        return f"EIG-{self.grade}"

    @property
    def order(self) -> int:  # type: ignore[override]
        return self.grade - 1

    @property
    def member(self) -> tuple:  # type: ignore[override]
        return int(self.grade), self.velocity != "none"


METHODS |= {f"eig{grade}": functools.partial(EIG, grade) for grade in range(4, 14)}


def _is_mass(m: Any) -> bool:
    is_number = isinstance(m, numbers.Real)
    return is_number and (0 < m <= _LARGEST or m == math.inf)


@dataclass(frozen=True)
class Langevin(Method):
    """BAOAB, for Langevin's equation u'' = f(t, u) - gamma v + thermal noise: Leimkuhler and Matthews (2013).

    Parameters
    ----------
    gamma : float
        Friction, 1/s.
    temperature : float
        k_B T in units of energy, such as J. A motion in a potential m phi(u), with f = -phi', approaches the
        distribution exp(-(m v^2/2 + m phi) / (k_B T)).
    mass : float or sequence of float, optional
        The mass m of all degrees of freedom, or of each degree of freedom, such as in kg: f is the force divided by it.
        An infinite mass has no noise. By default 1; the problem of a scene provides its masses, and refuses others.
    seed, stream : int
        Whole numbers from 0 to 2^53. A random number depends only on seed, stream, the step index and the degree of
        freedom. Member i of an ensemble has the stream `stream` + i, where i is its number in the whole ensemble.

    Raises
    ------
    ValueError
        If an option is not valid, a temperature is given without gamma, or the number of masses differs from the number
        of degrees of freedom.

    Notes
    -----
    By default there is neither friction nor noise: the method is then velocity Verlet, and so is ``method="langevin"``.
    The order is 2, also for averages. For an oscillator, the variance of u is k_B T / (m omega^2) at every step up to
    the limit omega h = 2, and the variance of v is k_B T / m (1 - (omega h)^2 / 4). With large friction, averages over
    u have the order 4.

    f must not read the velocity: such a force has another distribution, and BAOAB another order. States within a step,
    for `t_eval` and events, are interpolated without additional noise.
    """

    gamma: float = 0.0
    temperature: float = 0.0
    mass: float | Sequence[float] | None = None
    seed: int = 0
    stream: int = 0
    name: ClassVar[str] = "langevin"
    label: ClassVar[str] = "Langevin"
    kernel: ClassVar[str] = "eig3.kernels.methods.langevin"
    order: ClassVar[int] = 2
    ignores_velocity: ClassVar[bool] = True
    is_stochastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name, value in (("gamma", self.gamma), ("temperature", self.temperature)):
            if not (isinstance(value, numbers.Real) and 0 <= value <= _LARGEST):
                raise ValueError(f"{name} must be a finite number of at least 0, not {shown(value)}.")
        if self.temperature and not self.gamma:
            raise ValueError("temperature acts only with friction: give gamma too, such as gamma=1.0.")
        if self.mass is not None:
            masses: tuple[float, ...] = tuple(np.ravel(np.asarray(self.mass)).tolist())
            if not masses or not all(_is_mass(m) for m in masses):
                raise ValueError(f"mass must be a positive number, or a sequence of them, not {shown(self.mass)}.")
            object.__setattr__(self, "mass", masses if np.ndim(self.mass) else masses[0])  # hashable
        for name, count in (("seed", self.seed), ("stream", self.stream)):
            if not (isinstance(count, numbers.Integral) and 0 <= count <= _LARGEST_COUNT):
                raise ValueError(f"{name} must be a whole number from 0 to 2^53, not {shown(count)}.")

    def __repr__(self) -> str:
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        texts = (f"{name}=<{len(x)} values>" if np.ndim(x) else f"{name}={x!r}" for name, x in values.items())
        return f"Langevin({', '.join(texts)})"

    @property
    def _masses(self) -> float | Sequence[float]:
        return 1.0 if self.mass is None else self.mass

    @property
    def settings(self) -> tuple[float, ...]:
        return self.settings_of([0])

    def settings_of(self, members: Sequence[int]) -> tuple[float, ...]:
        streams = (float(self.stream + member) for member in members)
        weights = (1 / math.sqrt(mass) for mass in np.ravel(self._masses))
        return float(self.gamma), float(self.temperature), float(self.seed), float(len(members)), *streams, *weights

    def of_member(self, member: int) -> Method:
        return dataclasses.replace(self, stream=self.stream + member)

    def for_masses(self, masses: "np.ndarray", owner: str) -> Method:
        if self.mass is not None and not (np.size(self.mass) in (1, masses.size) and np.all(masses == self.mass)):
            raise ValueError(f"mass of Langevin must equal the masses of {owner}: leave it out.")
        is_same = bool((masses == masses[0]).all())
        return dataclasses.replace(self, mass=float(masses[0]) if is_same else masses.tolist())

    def without_noise(self) -> Method:
        return Langevin()  # friction does not change the limit of BAOAB

    def for_force(self, reads_velocity: bool, n: int) -> Method:
        if np.ndim(self._masses) and np.size(self._masses) != n:
            raise ValueError(
                f"mass must be a number, or {n} of them for {n} degrees of freedom, not {shown(self.mass)}."
            )
        return self


#: The names of the deterministic methods of the library. `METHODS` also contains stochastic methods, and methods that
#: a user defines.
LIBRARY: tuple[str, ...] = tuple(name for name, record in METHODS.items() if not record().is_stochastic)


#: The variants of CD in tables, by the letters of their labels.
_FORMS = {
    form: functools.partial(CentralDifference, solver=solver)
    for solver, forms in {"newton": ("cdnewton", "cdn"), "fixed-point": ("cdfixedpoint", "cdfp")}.items()
    for form in forms
}
#: The methods by the names that other packages give them, or to methods like them.
_ELSEWHERE = {"verlet": "cd", "velocityverlet": "cd", "leapfrog": "cd", "dop853": "rk8", "tsit5": "rk5", "heun": "rk2"}
_TOLERANCES = re.compile(r"(.+?)(?:,|\s)\s*(?:with\s+)?(?:tol\.?|tolerances|rtol.*)")


def named(text: str) -> tuple[Any, bool] | None:
    """Find a method by its name, or by the label that tables and pictures print, such as "EIG-3" or "RK8 tol.".

    Returns
    -------
    (callable, bool) or None
        The constructor of the method, and whether the label is for a run with tolerances; None if the method is
        unknown.
    """
    name = text.strip().lower()
    if name in METHODS:
        return METHODS[name], False
    with_tolerances = _TOLERANCES.fullmatch(name)
    letters = _letters(with_tolerances[1] if with_tolerances else name)
    labels = {_letters(getattr(record, "label", None)): record for record in METHODS.values()}
    known = {**labels, **_FORMS, **{_letters(name): record for name, record in METHODS.items()}}
    return (known[letters], bool(with_tolerances)) if letters and letters in known else None


def nearest(text: str) -> list[str]:
    """Return the names of methods that are similar to a text, the nearest first."""
    near = difflib.get_close_matches(_letters(text), [*METHODS, *_ELSEWHERE], n=3)
    return list(dict.fromkeys(_ELSEWHERE.get(name, name) for name in near))


def _letters(label: Any) -> str:
    """Return the letters and digits of a name or label; an empty text for other objects."""
    return re.sub(r"[\W_]", "", label.lower()) if isinstance(label, str) else ""


def shown(value: Any) -> str:
    """Return the repr of a value for an error message, cut to 60 characters."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python does not convert integers with thousands of digits
        return "an integer of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."
