"""The methods as records: what each is called, costs and promises, and which kernel runs it."""

import dataclasses
import math
import numbers
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from .kernels.fixed import Formulas, formulas

#: Every method by its short name; a record enters itself.
METHODS: dict[str, Any] = {}


class Method:
    """What every method's record holds. A subclass with a `name` is known to `eig3.integrate` by it.

    Attributes
    ----------
    name : str
        The short name that stands for the record's defaults in `eig3.integrate`.
    label : str
        The name in tables and pictures.
    order : int
        The order of convergence.
    evaluations : int or None
        Right-hand-side evaluations a step; None where an iteration decides.
    kernel : str
        The module that holds the formulas, as `eig3.kernels` describes it.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    order: ClassVar[int]
    evaluations: ClassVar[int | None] = 1
    kernel: ClassVar[str]
    ignores_velocity: ClassVar[bool] = False
    jacobian: Callable | None = None

    def __init_subclass__(cls) -> None:
        if "name" not in vars(cls):
            return
        name = cls.name.lower()
        known = METHODS.get(name)
        # A notebook may run a definition twice, but a name must not come to mean another method without an error.
        if known and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"name {name!r} is that of {known.__qualname__}; give {cls.__qualname__} another.")
        METHODS[name] = cls

    @property
    def is_implicit(self) -> bool:
        """Whether a step solves equations by iteration, so that the number of evaluations is not known before."""
        return self.evaluations is None

    @property
    def settings(self) -> tuple[float, ...]:
        """The numbers the kernel needs of the record."""
        return ()

    def for_force(self, reads_velocity: bool, n: int) -> "Method":
        """The record that runs, for a force on n degrees of freedom that reads the velocity or does not."""
        return self

    @property
    def fallback(self) -> "Method | None":
        """The record to go on with where the solve of a step does not converge."""
        return None

    def without_velocity(self) -> "Method":
        """The record to prefer for a force that does not read v."""
        return self

    @property
    def formulas(self) -> Formulas:
        """The formulas of the kernel, read when first asked for."""
        return formulas(self.kernel)


@dataclass(frozen=True)
class EIG3(Method):
    """Explicit integration of grade 3: one evaluation a step, explicit for every force.

    Parameters
    ----------
    alpha, beta : float
        Weights of a_n - a_{n-1} in the displacement and in the velocity. The order is 2 for beta = 1/2 and else 1.
        (1, 1/2) has no numerical damping and the largest stable step of the second-order sets, omega h < 2 undamped;
        with beta = 1/2 a larger alpha damps the high frequencies, and a smaller one is unstable for every step.
    velocity : {"auto", "explicit", "none"}
        "none" is for a force without velocity: (1, 1/2) then computes the same u and v with fewer arrays read and
        written. A force that reads the velocity at the start is refused. "auto" is "none" for a function that never
        reads its argument v, and else "explicit".
    """

    alpha: float = 1.0
    beta: float = 0.5
    velocity: str = field(default="auto", repr=False)
    name: ClassVar[str] = "eig3"
    label: ClassVar[str] = "EIG-3"

    def __post_init__(self) -> None:
        for name, value in (("alpha", self.alpha), ("beta", self.beta)):
            if not (isinstance(value, numbers.Real) and math.isfinite(value)):
                raise ValueError(f"{name} must be a finite number, not {value!r}.")
        if self.velocity not in ("auto", "explicit", "none"):
            raise ValueError(f"velocity must be 'auto', 'explicit' or 'none', not {self.velocity!r}.")

    @property
    def kernel(self) -> str:  # type: ignore[override]
        staggered = self.ignores_velocity and self.settings == (1.0, 0.5)
        return "eig3.kernels.eig3_staggered" if staggered else "eig3.kernels.eig3"

    @property
    def ignores_velocity(self) -> bool:  # type: ignore[override]
        return self.velocity == "none"

    def for_force(self, reads_velocity: bool, n: int) -> Method:
        return self.without_velocity() if self.velocity == "auto" and not reads_velocity else self

    def without_velocity(self) -> Method:
        return dataclasses.replace(self, velocity="none")

    @property
    def order(self) -> int:  # type: ignore[override]
        return 2 if self.beta == 0.5 else 1

    @property
    def settings(self) -> tuple[float, ...]:
        return float(self.alpha), float(self.beta)


@dataclass(frozen=True, repr=False)
class CentralDifference(Method):
    """Central difference: the classical explicit method of structural dynamics, implicit where f depends on velocity.

    Parameters
    ----------
    velocity : {"auto", "implicit", "none", "lagged"}
        "implicit" solves v = w + h/2 f(t, u, v) at every step: second order for every force. "none" is for a force
        without velocity: one evaluation and no solve. A force that reads the velocity at the start is refused. "auto"
        is "none" for a function that never reads its argument v, and else "implicit". "lagged" gives f the velocity of
        half a step before: explicit, but of first order only. It is there to be shown, not to be preferred.
    solver : {"auto", "newton", "fixed-point"}
        How "implicit" solves. Newton's method converges also where h df/dv is large. Fixed-point iteration is cheaper
        where it is small. "auto" iterates, and changes to Newton's method for the rest of the run at the first step
        where the iteration takes long or does not converge; with a jacobian it is "newton".
    jacobian : jitted function, optional
        df/dv for Newton's method: ``jacobian(t, u, v, p, J)``, writing the entries of the n x n array J, which come
        zeroed; or ``jacobian(t, u, v, p) -> float`` for one degree of freedom. Without it, differences of f.
    tol : float
        The iteration ends when the residual of v is below tol (|v| + |w|), each summed over the degrees of freedom, or
        no longer falls and moves u by less than its round-off. One degree of freedom much smaller than the others is
        solved less closely: scale mixed units.
    max_iterations : int
        Iterations in one step before the run ends as NOT_CONVERGED.
    """

    velocity: str = "auto"
    solver: str = "auto"
    jacobian: Callable | None = None
    tol: float = 1e-12
    max_iterations: int = 50
    name: ClassVar[str] = "cd"
    label: ClassVar[str] = "CD"

    def __post_init__(self) -> None:
        if self.velocity not in ("auto", "implicit", "none", "lagged"):
            raise ValueError(f"velocity must be 'auto', 'implicit', 'none' or 'lagged', not {self.velocity!r}.")
        if self.solver not in ("auto", "newton", "fixed-point"):
            raise ValueError(f"solver must be 'auto', 'newton' or 'fixed-point', not {self.solver!r}.")
        if self.jacobian is not None and not (self.is_implicit and self.solver != "fixed-point"):
            raise ValueError("jacobian is used by velocity='implicit' with solver='newton' only; leave it out.")
        if not (isinstance(self.tol, numbers.Real) and 0 < self.tol < 1):
            raise ValueError(f"tol must be a number between 0 and 1, not {self.tol!r}.")
        if not (isinstance(self.max_iterations, numbers.Integral) and self.max_iterations >= 1):
            raise ValueError(f"max_iterations must be a whole number of at least 1, not {self.max_iterations!r}.")

    def __repr__(self) -> str:
        changed = [f for f in dataclasses.fields(self) if getattr(self, f.name) != f.default]
        return f"CentralDifference({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in changed)})"

    @property
    def kernel(self) -> str:  # type: ignore[override]
        if not self.is_implicit:
            return "eig3.kernels.cd"
        newton = self.solver == "newton" or self.jacobian is not None
        return "eig3.kernels.cd_newton" if newton else "eig3.kernels.cd_fixed_point"

    @property
    def order(self) -> int:  # type: ignore[override]
        return 1 if self.velocity == "lagged" else 2

    @property
    def evaluations(self) -> int | None:  # type: ignore[override]
        return None if self.velocity in ("auto", "implicit") else 1

    @property
    def ignores_velocity(self) -> bool:  # type: ignore[override]
        return self.velocity == "none"

    def for_force(self, reads_velocity: bool, n: int) -> Method:
        if self.velocity == "auto" and not reads_velocity:
            return self.without_velocity()
        if self.fallback is None:
            return self
        # Newton's method with differences takes some 2 n + 3 evaluations: more iterations than those do not pay.
        return dataclasses.replace(self, solver="fixed-point", max_iterations=min(self.max_iterations, 8 + 4 * n))

    @property
    def fallback(self) -> Method | None:
        iterates_first = self.is_implicit and self.solver == "auto" and self.jacobian is None
        return dataclasses.replace(self, solver="newton") if iterates_first else None

    def without_velocity(self) -> Method:
        return dataclasses.replace(self, velocity="none", jacobian=None)

    @property
    def settings(self) -> tuple[float, ...]:
        return float(self.tol), float(self.max_iterations)


@dataclass(frozen=True)
class RK2(Method):
    """Heun's method, the Runge-Kutta method of the article: two evaluations a step, unstable without damping."""

    name: ClassVar[str] = "rk2"
    label: ClassVar[str] = "RK2"
    kernel: ClassVar[str] = "eig3.kernels.rk2"
    order: ClassVar[int] = 2
    evaluations: ClassVar[int] = 2


@dataclass(frozen=True)
class RK3(Method):
    """Kutta's third-order method: three evaluations a step, stable undamped up to omega h = sqrt 3."""

    name: ClassVar[str] = "rk3"
    label: ClassVar[str] = "RK3"
    kernel: ClassVar[str] = "eig3.kernels.rk3"
    order: ClassVar[int] = 3
    evaluations: ClassVar[int] = 3


@dataclass(frozen=True)
class RK4(Method):
    """The classical Runge-Kutta method: four evaluations a step, stable undamped up to omega h = 2 sqrt 2."""

    name: ClassVar[str] = "rk4"
    label: ClassVar[str] = "RK4"
    kernel: ClassVar[str] = "eig3.kernels.rk4"
    order: ClassVar[int] = 4
    evaluations: ClassVar[int] = 4


@dataclass(frozen=True)
class AB2(Method):
    """Adams-Bashforth of second order: one evaluation a step, unstable without damping."""

    name: ClassVar[str] = "ab2"
    label: ClassVar[str] = "AB2"
    kernel: ClassVar[str] = "eig3.kernels.ab2"
    order: ClassVar[int] = 2


@dataclass(frozen=True)
class AB3(Method):
    """Adams-Bashforth of third order: one evaluation a step, stable undamped up to omega h = 0.7236."""

    name: ClassVar[str] = "ab3"
    label: ClassVar[str] = "AB3"
    kernel: ClassVar[str] = "eig3.kernels.ab3"
    order: ClassVar[int] = 3


#: The methods of the library. Unlike `METHODS` it never holds a method that a user has defined.
LIBRARY: tuple[type[Method], ...] = (EIG3, CentralDifference, RK2, RK3, RK4, AB2, AB3)
