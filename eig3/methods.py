"""The methods as records: what each is called, costs and promises, and which kernel runs it."""

import dataclasses
import importlib
import math
import numbers
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, ClassVar

from .kernels.jit import Form

#: Every method by its short name; a record enters itself.
METHODS: dict[str, Any] = {}


class Method:
    """What every method's record tells. A subclass with a `name` is known to `eig3.integrate` by it.

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
        The module that holds the kernel, as `eig3.kernels` describes it.
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
        # a notebook may run a definition twice, but a name must not come to mean another method unseen
        if known and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"name {name!r} is that of {known.__qualname__}; give {cls.__qualname__} another.")
        METHODS[name] = cls

    @property
    def settings(self) -> tuple[float, ...]:
        """The numbers the kernel needs of the record."""
        return ()

    def workspace_bytes(self, n: int) -> int:
        """What a run of n degrees of freedom needs beyond a few vectors."""
        return 0

    def without_velocity(self) -> "Method":
        """The record to prefer for a force that does not read v."""
        return self

    @property
    def module(self) -> ModuleType:
        """The module of the kernel, imported when first asked for."""
        module = importlib.import_module(self.kernel)
        missing = [name for name in ("start", "scratch", "scalar", "vector") if not hasattr(module, name)]
        if missing:
            raise TypeError(f"kernel {self.kernel!r} must define {', '.join(missing)}: see eig3.kernels.")
        return module

    def function(self, form: Form) -> Callable:
        """The kernel for a form of right-hand side, as plain Python."""
        return getattr(self.module, form.name + ("" if self.jacobian is None else "_jacobian"))


@dataclass(frozen=True)
class EIG3(Method):
    """Explicit integration of grade 3: one evaluation a step, explicit for every force.

    Parameters
    ----------
    alpha, beta : float
        Weights of a_n - a_{n-1} in the displacement and in the velocity. The order is 2 for beta = 1/2 and else 1.
        (1, 1/2) has no numerical damping and the largest stable step of the second-order sets, omega h < 2 undamped;
        with beta = 1/2 a larger alpha damps the high frequencies, and a smaller one is unstable for every step.
    velocity : {"explicit", "none"}
        "none" is for a force without velocity: (1, 1/2) then computes the same u and v with fewer arrays read and
        written. A force that reads velocity is refused where it does so at the start.
    """

    alpha: float = 1.0
    beta: float = 0.5
    velocity: str = field(default="explicit", repr=False)
    name: ClassVar[str] = "eig3"
    label: ClassVar[str] = "EIG-3"

    def __post_init__(self) -> None:
        for name, value in (("alpha", self.alpha), ("beta", self.beta)):
            if not (isinstance(value, numbers.Real) and math.isfinite(value)):
                raise ValueError(f"{name} must be a finite number, not {value!r}.")
        if self.velocity not in ("explicit", "none"):
            raise ValueError(f"velocity must be 'explicit' or 'none', not {self.velocity!r}.")

    @property
    def kernel(self) -> str:  # type: ignore[override]
        staggered = self.ignores_velocity and self.settings == (1.0, 0.5)
        return "eig3.kernels.eig3_staggered" if staggered else "eig3.kernels.eig3"

    @property
    def ignores_velocity(self) -> bool:  # type: ignore[override]
        return self.velocity == "none"

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
    velocity : {"implicit", "none", "lagged"}
        "implicit" solves v = w + h/2 f(t, u, v) at every step: second order for every force. "none" is for a force
        without velocity: one evaluation and no solve; a force that reads velocity is refused where it does so at the
        start. "lagged" gives f the velocity of half a step before: explicit, but of first order only, and there to be
        shown rather than preferred.
    solver : {"newton", "fixed-point"}
        How "implicit" solves. Newton's method converges also where h df/dv is large; fixed-point iteration is cheaper
        where it is small.
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

    velocity: str = "implicit"
    solver: str = "newton"
    jacobian: Callable | None = None
    tol: float = 1e-12
    max_iterations: int = 50
    name: ClassVar[str] = "cd"
    label: ClassVar[str] = "CD"

    def __post_init__(self) -> None:
        if self.velocity not in ("implicit", "none", "lagged"):
            raise ValueError(f"velocity must be 'implicit', 'none' or 'lagged', not {self.velocity!r}.")
        if self.solver not in ("newton", "fixed-point"):
            raise ValueError(f"solver must be 'newton' or 'fixed-point', not {self.solver!r}.")
        if self.jacobian is not None and self.kernel != "eig3.kernels.cd_newton":
            raise ValueError("jacobian is used by velocity='implicit' with solver='newton' only; leave it out.")
        if not (isinstance(self.tol, numbers.Real) and 0 < self.tol < 1):
            raise ValueError(f"tol must be a number between 0 and 1, not {self.tol!r}.")
        if not (isinstance(self.max_iterations, numbers.Integral) and self.max_iterations >= 1):
            raise ValueError(f"max_iterations must be a whole number of at least 1, not {self.max_iterations!r}.")

    def __repr__(self) -> str:
        told = [f for f in dataclasses.fields(self) if getattr(self, f.name) != f.default]
        return f"CentralDifference({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in told)})"

    @property
    def kernel(self) -> str:  # type: ignore[override]
        if self.velocity != "implicit":
            return "eig3.kernels.cd"
        return "eig3.kernels.cd_newton" if self.solver == "newton" else "eig3.kernels.cd_fixed_point"

    @property
    def order(self) -> int:  # type: ignore[override]
        return 1 if self.velocity == "lagged" else 2

    @property
    def evaluations(self) -> int | None:  # type: ignore[override]
        return None if self.velocity == "implicit" else 1

    @property
    def ignores_velocity(self) -> bool:  # type: ignore[override]
        return self.velocity == "none"

    def without_velocity(self) -> Method:
        return dataclasses.replace(self, velocity="none", jacobian=None)

    def workspace_bytes(self, n: int) -> int:
        # the matrix, and its copy in the state that the stepper can go back to
        return 16 * n * n if self.kernel == "eig3.kernels.cd_newton" and n > 1 else 0

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


#: The library's own methods, without those a user has defined.
LIBRARY: tuple[type[Method], ...] = (EIG3, CentralDifference, RK2, RK3, RK4, AB2, AB3)
