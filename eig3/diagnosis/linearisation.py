"""Linearise a system at a state: u'' = -K u - C v. A large system is projected on the directions of fast motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..functions.guard import guarded
from ..methods import Method
from ..stepping.stepper import Stepper
from .blas_threads import one_blas_thread

_FULL = 64  # degrees of freedom up to which K and C are full matrices
_DIRECTIONS = 60  # dimension of a Krylov space
_FEW_DIRECTIONS = 12  # dimension of a Krylov space for only the largest rates
_VALUES = 2**25  # largest number of values in the stored vectors: 256 MB
_INCREMENT = 2.0**-26  # first increment of u or v, relative to its size: balances truncation against round-off
_LONGEST_INCREMENT = 2.0**-10  # longest increment, relative to the size of u or v
_TELLING = 2.0**-40  # least change of the acceleration, relative to its terms: three of its digits are above round-off
_UNCERTAIN = 2.0**-49  # round-off of the acceleration, relative to its terms
_ROUNDED = 2.0**-51  # a relative change of u of about its round-off
_LENGTHENED = 2.0**9  # factor to an increment of 2^-17, the cube root of round-off, for central differences
_SMOOTH = 1e-6  # rhs is smooth if the quotients over the two increments differ by at most this, relatively
_STRAIGHT = 1e-2  # rhs is straight over an increment if two quotients differ by at most this, relatively
_ROUND_OFF = 1e-6  # relative round-off of products by differences
_BALANCINGS = 10  # of all unknowns
_BALANCED = 10  # powers of 2 by which the unit of an unknown may differ from the best one
_SMALLER_UNIT = 2.0**-15  # an acceleration below this fraction of the largest one shows another unit
_UNEVEN = 2.0**10  # units of the unknowns are changed if a product is then smaller by this factor
_FAINT = 1e-9  # of the largest rate: such a product with a random vector is from squares of v, which damp nothing
_UNDAMPED = 1e-6  # damping ratio below which a system counts as undamped


@dataclass(frozen=True)
class Linearised:
    """-df/du and -df/dv at a state, as the matrices K and C on orthonormal directions.

    Up to 64 degrees of freedom these are all directions, and `is_complete` is true. Above, they span Krylov spaces,
    which contain the highest frequencies and the strongest dampings to about 0.1 %. `evaluations` counts the
    evaluations of f. Not every method takes a system that `has_constraints`.
    """

    K: np.ndarray
    C: np.ndarray
    evaluations: int
    is_complete: bool = True
    has_constraints: bool = False

    def rates(self) -> np.ndarray:
        """The rates s of the solutions exp(s t); a conjugate pair is a mode that oscillates."""
        return np.linalg.eigvals(self._first_order)

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """The rates, and for each a column with the displacements and velocities of its solution."""
        return np.linalg.eig(self._first_order)  # type: ignore[return-value]

    @property
    def _first_order(self) -> np.ndarray:
        zero, one = np.zeros_like(self.K), np.eye(len(self.K))
        return np.block([[zero, one], [-self.K, -self.C]])

    def fastest(self, count: int) -> Linearised:
        """Project on `count` directions in which K is largest, and as many each for C and for their combination."""
        norm_k, norm_c = (float(np.linalg.norm(x, 2)) for x in (self.K, self.C))
        combined = _combination(norm_k, norm_c, self.K, self.C)
        V = _orthonormal(np.concatenate([np.linalg.svd(x)[2][:count] for x in (self.K, self.C, combined)]))
        is_complete = self.is_complete and len(V) == len(self.K)
        return Linearised(V @ self.K @ V.T, V @ self.C @ V.T, self.evaluations, is_complete)


class _Derivative:
    """Products of -df/dx with vectors, by differences of ``f(x)``; `a` is f at the state."""

    def __init__(
        self, f: Callable, x: np.ndarray, a: np.ndarray, scale: float, terms: float, along: Callable | None = None
    ) -> None:
        self._f, self._x, self._a, self._scale, self._along = f, x, a, scale, along
        self._noise, self._round_off = _TELLING * terms, _UNCERTAIN * terms
        self.size = x.size
        # a state of a link at 0 may have a unit that is much smaller than the unit of velocities
        own = scale * np.abs(a) / (terms or 1.0)
        self.natural = np.where(own < _SMALLER_UNIT * scale, own, 0.0)

    def __call__(self, w: np.ndarray, increment: float) -> np.ndarray:
        """Return the product on the stiffer side. The sides differ at a kink, such as the beginning of a contact."""
        ahead, behind = self._sides(w, increment)
        product = np.where(np.abs(ahead) >= np.abs(behind), ahead, behind)
        if not np.isfinite(product).all():
            raise ValueError("rhs is not finite close to this state; give another state.")
        return product

    def _sides(self, w: np.ndarray, increment: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the products from the forward and the backward difference."""
        dx = increment / float(np.abs(w).max())
        w = self._along(w) if self._along else w
        ahead, behind = (self._a - self._f(self._x + dx * w)) / dx, (self._f(self._x - dx * w) - self._a) / dx
        return (self._along(ahead), self._along(behind)) if self._along else (ahead, behind)

    def column(self, w: np.ndarray, scale: float) -> np.ndarray:
        """Return the product from central differences over a longer increment, which have less round-off.

        If f is not smooth over this increment, return the product from `measure`, whose round-off may be larger than
        the limit of smoothness.
        """
        size, product = self.measure(w, scale)
        with np.errstate(over="ignore", invalid="ignore"):
            ahead, behind = self._sides(w, _LENGTHENED * size)
            mean = (ahead + behind) / 2
            smooth = np.abs(mean - product).max() <= max(_SMOOTH * np.abs(product).max(), self._round_off / size)
        return mean if smooth else product

    def measure(self, w: np.ndarray, scale: float = 0.0) -> tuple[float, np.ndarray]:
        """Find an increment along w over which f is nearly linear, but changes much more than its round-off.

        Return it, which is the change of the largest entry of x, and the product.
        """
        size, longest = _INCREMENT * (scale or self._scale), _LONGEST_INCREMENT * self._scale
        largest = float(np.abs(w).max())
        product = self(w, size)
        while float(np.abs(product).max()) * size / largest < self._noise and 64 * size <= longest:
            size *= 64
            product = self(w, size)
        for _ in range(20):
            before, finer = product, self(w, size / 16)
            change = float(np.abs(finer).max()) * size / 16 / largest
            if change <= self._noise or np.abs(finer - product).max() <= _STRAIGHT * np.abs(product).max():
                break
            size, product = size / 16, finer
        else:
            if np.abs(finer).max() < np.abs(before).max():  # f has no linear part, as squares of v at rest
                product = np.zeros_like(product)
        return size, product


def linearise_at(stepper: Stepper, method: Method) -> Linearised:
    """Linearise the system of a stepper at its state, as it acts on the steps of a method.

    EIG-3 finds the reactions of constraints from the end of the step, and not from u and v. Only changes of u and v
    along the constraints act on its steps.
    """
    t, u, v, along = stepper.t, stepper.u, stepper.v, None
    if stepper.system.project and method.with_constraints().formulas.keeps_constraints:
        project, params = stepper.system.project.call, guarded(stepper.p)

        def projected(w: np.ndarray) -> np.ndarray:
            place, w = u.copy(), w.copy()
            project(t, place, w, params)
            return w

        at_rest = projected(np.zeros_like(u))  # not zero if the constraints move

        def along(w: np.ndarray) -> np.ndarray:
            return projected(w) - at_rest

    return replace(linearise(stepper.evaluator(), t, u, v, along), has_constraints=bool(stepper.system.project))


@one_blas_thread
def linearise(f: Callable, t: float, u: Any, v: Any, along: Callable | None = None) -> Linearised:
    """Linearise ``f(t, u, v)`` at a state. For more than 64 degrees of freedom, no n x n matrix is stored.

    `along` projects changes of u, v and f.

    Raises
    ------
    ValueError
        If f is not finite close to the state.
    """
    evaluations = 0

    def counted(*state: Any) -> Any:
        nonlocal evaluations
        evaluations += 1
        return f(*state)

    by_u, by_v = _derivatives(counted, t, u, v, along)
    u, v = np.atleast_1d(u), np.atleast_1d(v)
    is_small = u.size <= _FULL
    K, C = _balanced(*_all_directions(by_u, by_v, u, v)) if is_small else _fast_directions(by_u, by_v, u.size)
    if np.linalg.norm(C, 2) <= _UNDAMPED * math.sqrt(np.linalg.norm(K, 2)):
        C = np.zeros_like(K)  # at v = 0, a force with the square of v gives a small damping in the differences
    return Linearised(K, C, evaluations, is_small)


@one_blas_thread
def fast_rates(f: Callable, t: float, u: Any, v: Any, h: float) -> np.ndarray:
    """Return some of the rates s of the solutions exp(s t) at a state as s h, including the largest, at a low cost.

    They are the eigenvalues of (u, h v) -> h d(u, h v)/dt on a small Krylov space. Those with the largest absolute
    values are accurate to some percent.

    Raises
    ------
    ValueError
        If f is not finite close to the state.
    """
    n = np.size(u)
    w = np.random.default_rng(4).standard_normal(2 * n)
    by_u, by_v = _derivatives(f, t, u, v)
    (du, _), (dv, _), acts = _acting(by_u, by_v, w[:n], w[n:])
    w *= np.tile(acts, 2)

    def product(w: np.ndarray) -> np.ndarray:
        wu, wv = w[:n], w[n:]
        ku, cv = (by(x, d) if x.any() else x for by, x, d in ((by_u, wu, du), (by_v, wv, dv)))
        return np.concatenate([wv, -h * (h * ku + cv)])

    return np.linalg.eigvals(_arnoldi(product, w, min(2 * n, _FEW_DIRECTIONS))[1])


def _derivatives(
    f: Callable, t: float, u: Any, v: Any, along: Callable | None = None
) -> tuple[_Derivative, _Derivative]:
    """Return the products with -df/du and with -df/dv at a state, for many unknowns in units that suit their coupling.

    For up to 64 unknowns, `_balanced` changes the units.
    """
    scalar = np.ndim(u) == 0
    u, v = np.atleast_1d(u), np.atleast_1d(v)

    def evaluate(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.atleast_1d(f(t, float(u[0]), float(v[0]))) if scalar else f(t, u, v)

    products = _products(evaluate, u, v, along)
    units = _units(products[0]) if u.size > _FULL else None
    if units is None:
        return products
    scaled = along and (lambda w: along(w * units) / units)
    return _products(lambda u, v: evaluate(u * units, v * units) / units, u / units, v / units, scaled)


def _units(by_u: _Derivative) -> np.ndarray | None:
    """Return units of the unknowns in which a stiffness is much smaller, or None if there are none.

    Rows of the matrix have very different sizes where, say, lengths of planets are beside angles. Products with random
    vectors have these sizes: T.-Y. Chen and J. Demmel, Linear Algebra and its Applications 309 (2000), 261.
    """
    first, second = np.random.default_rng(5).standard_normal((2, by_u.size))
    increment, product = by_u.measure(first)
    sizes = np.maximum(np.abs(product), np.abs(by_u(second, increment)))
    units = 2.0 ** np.round(np.log2(np.where(sizes > 0, sizes / (sizes.max() or 1.0), 1.0)))
    smaller = np.abs(by_u.measure(first * units)[1] / units).max()
    return units if smaller * _UNEVEN < sizes.max() else None


def _products(
    evaluate: Callable, u: np.ndarray, v: np.ndarray, along: Callable | None
) -> tuple[_Derivative, _Derivative]:
    a = evaluate(u, v)
    u_size, v_size = (float(np.abs(x).max()) for x in (u, v))
    terms = max(float(np.abs(a).max()), _cancelled(lambda x: evaluate(x, v), u, a))
    natural = math.sqrt(terms) * math.sqrt(u_size)  # the velocity that a motion from rest at u can reach
    by_u = _Derivative(lambda x: evaluate(x, v), u, a, u_size or 1.0, terms, along)
    by_v = _Derivative(lambda x: evaluate(u, x), v, a, max(v_size, natural) or 1.0, terms, along)
    return by_u, by_v


def _cancelled(f: Callable, u: np.ndarray, a: np.ndarray) -> float:
    """Estimate the size of the terms that cancel in a = f(u), as in an equilibrium, from small changes of u."""
    signs = np.random.default_rng(3).choice((-1.0, 1.0), u.size)
    change = np.abs(f(u * (1 + _ROUNDED * signs)) - a).max() / _ROUNDED
    return float(change) if math.isfinite(change) else 0.0


def _all_directions(
    by_u: _Derivative, by_v: _Derivative, u: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the full K and C. Each column has a separate increment, because u may contain lengths and angles."""
    units = np.eye(u.size)
    sizes = np.abs(u), np.where(v == 0, by_v.natural, np.abs(v))
    K, C = (
        np.transpose([d.column(w, float(x[j])) for j, w in enumerate(units)])
        for d, x in zip((by_u, by_v), sizes, strict=True)
    )
    return K, C


def _balanced(K: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K and C without unknowns on which no force acts or which cause none, and with others in suitable units.

    Neither changes a rate, apart from zeros: such unknowns are the states of links, which change only at events, and
    integrals such as the work. Units may differ by many powers of ten, as of lengths and rates of atoms in SI units.
    """
    coupled: Any = np.zeros(len(K), dtype=bool)
    while not coupled.all():
        coupled = (K.any(axis=1) | C.any(axis=1)) & (K.any(axis=0) | C.any(axis=0))
        if not coupled.any():
            return np.zeros((1, 1)), np.zeros((1, 1))
        K, C = K[np.ix_(coupled, coupled)], C[np.ix_(coupled, coupled)]
    sizes = np.abs(K) / (np.abs(K).max() or 1.0) + np.abs(C) / (np.abs(C).max() or 1.0)
    np.fill_diagonal(sizes, 0.0)
    units = np.ones(len(K))
    for _ in range(_BALANCINGS):  # E. E. Osborne, Journal of the ACM 7 (1960), 338
        for j in range(len(K)):
            row, column = (sizes[j] @ units) / units[j], (sizes[:, j] / units).sum() * units[j]
            powers = np.log2(row / column) / 2 if row > 0 and column > 0 else 0.0
            units[j] *= 2.0 ** np.round(powers) if abs(powers) > _BALANCED else 1.0
    return K * units / units[:, None], C * units / units[:, None]


def _acting(by_u: _Derivative, by_v: _Derivative, wu: np.ndarray, wv: np.ndarray) -> tuple[Any, Any, np.ndarray]:
    """Return what `measure` returns along two vectors, and a mask of the unknowns on which forces act.

    The others are left out of the vectors: see `_balanced`.
    """
    of_u, of_v = by_u.measure(wu), by_v.measure(wv)
    acts = (of_u[1] != 0) | (of_v[1] != 0)
    if acts.all() or not acts.any():
        return of_u, of_v, np.ones_like(acts)
    return by_u.measure(wu * acts), by_v.measure(wv * acts), acts


def _fast_directions(by_u: _Derivative, by_v: _Derivative, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return K and C on the directions in which K, C, and their combination that limits the step, are largest."""
    w = np.random.default_rng(2).standard_normal(n)
    (du, _), (dv, cw), acts = _acting(by_u, by_v, w, w)

    def k(w: np.ndarray) -> np.ndarray:
        return by_u(w, du)

    def c(w: np.ndarray) -> np.ndarray:
        return by_v(w, dv)

    stiff, H = _krylov_space(k, acts)
    if np.abs(cw).max() <= _FAINT * math.sqrt(np.linalg.norm(H, 2)) * np.abs(w).max():
        return H, np.zeros_like(H)
    CV = np.array([c(w) for w in stiff])
    # With damping proportional to mass and stiffness, only the last direction leaves the space.
    if np.linalg.norm(CV[:-1] - (CV[:-1] @ stiff.T) @ stiff) <= _ROUND_OFF * np.linalg.norm(CV):
        m = max(1, len(stiff) - 1)
        return H[:m, :m], stiff[:m] @ CV[:m].T
    strong, G = _krylov_space(c, acts)
    norms = _largest(H), _largest(G)
    both, _ = _krylov_space(lambda w: _combination(*norms, k(w), c(w)), acts)
    V = _orthonormal(np.concatenate([part[: _DIRECTIONS // 2] for part in (stiff, strong, both)]))
    return V @ np.transpose([k(w) for w in V]), V @ np.transpose([c(w) for w in V])


def _largest(H: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(H)).max())


def _combination(k: float, c: float, K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return h^2 K + 3 h C for the step h with h^2 k + 3 h c = 4, which is near the stability limit.

    The largest eigenvalue of such a sum sets the limit. In place of 3, the exact factor is 4 for EIG-3, 0 for central
    difference, and 2 for central difference with a lagged velocity.
    """
    root = 3 * c + math.sqrt(9 * c * c + 16 * k)
    h = 8 / root if root > 0 else 1.0
    return h * h * K + 3 * h * C


def _krylov_space(apply: Callable, acts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an orthonormal basis of a Krylov space by Arnoldi's iteration, and the operator in this basis.

    The vectors are zero for unknowns on which no force acts.

    `scipy.sparse.linalg.eigs` returns no such basis, and `critical_step` and `explain` do not need SciPy.
    If there is memory for only few vectors, the iteration restarts from the best vector.
    """
    most = max(8, min(_DIRECTIONS, _VALUES // (3 * acts.size)))
    w = np.random.default_rng(1).standard_normal(acts.size) * acts
    for _ in range(math.ceil(_DIRECTIONS / most)):
        V, H = _arnoldi(apply, w, most)
        values, vectors = np.linalg.eig(H)
        best = vectors[:, np.argmax(np.abs(values))]
        w = (best.real + best.imag) @ V
    return V, H


def _arnoldi(apply: Callable, w: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    V, H = np.empty((most, w.size)), np.zeros((most, most))
    V[0] = w / np.linalg.norm(w)
    for j in range(most):
        w = apply(V[j])
        before = np.linalg.norm(w)
        for _ in range(2):  # the second pass removes round-off
            along = V[: j + 1] @ w
            H[: j + 1, j] += along
            w = w - along @ V[: j + 1]
        after = np.linalg.norm(w)
        if not after > _ROUND_OFF * before or j + 1 == most:
            break
        H[j + 1, j] = after
        V[j + 1] = w / after
    return V[: j + 1], H[: j + 1, : j + 1]


def _orthonormal(W: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the row space, without directions that come only from round-off."""
    Q, R = np.linalg.qr(W.T)
    left, sizes, _ = np.linalg.svd(R)
    return (Q @ left[:, sizes > _ROUND_OFF * sizes[0]]).T
