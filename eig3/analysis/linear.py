"""A system about a state, u'' = -K u - C v, on the few directions in which it is fastest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_FULL = 64  # degrees of freedom up to which all directions are taken
_DIRECTIONS = 60
_VALUES = 2**25  # of all the vectors kept: 256 MB
_INCREMENT = 2.0**-26  # of u or v, relatively, to begin with: balances truncation against round-off
_LONGEST_INCREMENT = 2.0**-10
_TELLING = 2.0**-40  # of the acceleration: a change that its round-off leaves three digits of
_ROUNDED = 2.0**-51  # a change of u, relatively, that is hardly more than round-off
_STRAIGHT = 1e-2  # difference of two quotients of a function that is straight enough
_ROUND_OFF = 1e-6  # of products, where differences give them
_UNDAMPED = 1e-6  # damping ratio


@dataclass(frozen=True)
class Linearised:
    """-df/du and -df/dv at a state.

    Attributes
    ----------
    K, C : ndarray, shape (m, m)
        On m orthonormal directions: all of them in a system of up to 64 degrees of freedom, else those of Krylov
        spaces, in which the highest frequencies and the strongest dampings of the whole are met to some 0.1 %.
    evaluations : int
        Of f.
    """

    K: np.ndarray
    C: np.ndarray
    evaluations: int

    def rates(self) -> np.ndarray:
        """The eigenvalues s of exp(s t), of which a conjugate pair stands for a mode that oscillates."""
        zero, one = np.zeros_like(self.K), np.eye(len(self.K))
        return np.linalg.eigvals(np.block([[zero, one], [-self.K, -self.C]]))

    def fastest(self, count: int) -> Linearised:
        """The same on the `count` directions in which each of K, C and their combination is largest."""
        norm_k, norm_c = (float(np.linalg.norm(x, 2)) for x in (self.K, self.C))
        combined = _combination(norm_k, norm_c, self.K, self.C)
        V = _orthonormal(np.concatenate([np.linalg.svd(x)[2][:count] for x in (self.K, self.C, combined)]))
        return Linearised(V @ self.K @ V.T, V @ self.C @ V.T, self.evaluations)


class _Derivative:
    """Products of -df/dx with vectors, by differences of ``f(x)``, of which `a` is the value in the middle."""

    def __init__(self, f: Callable, x: np.ndarray, a: np.ndarray, scale: float, terms: float) -> None:
        self._f, self._x, self._a, self._scale = f, x, a, scale
        self._noise = _TELLING * terms

    def __call__(self, w: np.ndarray, increment: float) -> np.ndarray:
        """The stiffer of the two sides: at a kink, as where a contact begins, they differ."""
        dx = increment / float(np.abs(w).max())
        ahead = (self._a - self._f(self._x + dx * w)) / dx
        behind = (self._f(self._x - dx * w) - self._a) / dx
        product = np.where(np.abs(ahead) >= np.abs(behind), ahead, behind)
        if not np.isfinite(product).all():
            raise ValueError("rhs is not finite close to this state; give another.")
        return product

    def measure(self, w: np.ndarray, scale: float = 0.0) -> tuple[float, np.ndarray]:
        """A change of x along w, by its largest entry, short for f to be straight and telling for its digits; with it,
        the product.
        """
        size, longest = _INCREMENT * (scale or self._scale), _LONGEST_INCREMENT * self._scale
        largest = float(np.abs(w).max())
        product = self(w, size)
        while float(np.abs(product).max()) * size / largest < self._noise and 64 * size <= longest:
            size *= 64
            product = self(w, size)
        for _ in range(20):
            finer = self(w, size / 16)
            told = float(np.abs(finer).max()) * size / 16 / largest
            if told <= self._noise or np.abs(finer - product).max() <= _STRAIGHT * np.abs(product).max():
                break
            size, product = size / 16, finer
        return size, product


def linearise(f: Callable, t: float, u: Any, v: Any) -> Linearised:
    """Linearise ``f(t, u, v)`` at a state, without ever holding a matrix of its size.

    Raises
    ------
    ValueError
        Where f is not finite close to the state.
    """
    scalar, evaluations = np.ndim(u) == 0, 0
    u, v = np.atleast_1d(u), np.atleast_1d(v)

    def evaluate(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        nonlocal evaluations
        evaluations += 1
        return np.atleast_1d(f(t, float(u[0]), float(v[0]))) if scalar else f(t, u, v)

    a = evaluate(u, v)
    u_size, v_size = (float(np.abs(x).max()) for x in (u, v))
    terms = max(float(np.abs(a).max()), _cancelled(lambda x: evaluate(x, v), u, a))
    natural = math.sqrt(terms) * math.sqrt(u_size)  # the velocity of a motion that turns at u, and rests there now
    by_u = _Derivative(lambda x: evaluate(x, v), u, a, u_size or 1.0, terms)
    by_v = _Derivative(lambda x: evaluate(u, x), v, a, max(v_size, natural) or 1.0, terms)
    K, C = _all_directions(by_u, by_v, u, v) if u.size <= _FULL else _fast_directions(by_u, by_v, u.size)
    if np.linalg.norm(C, 2) <= _UNDAMPED * math.sqrt(np.linalg.norm(K, 2)):
        C = np.zeros_like(K)  # differences see a damping where f has the square of a velocity that is zero here
    return Linearised(K, C, evaluations)


def _cancelled(f: Callable, u: np.ndarray, a: np.ndarray) -> float:
    """The size of the terms that cancel in a = f(u), as in an equilibrium: by what the round-off of u makes of them."""
    signs = np.random.default_rng(3).choice((-1.0, 1.0), u.size)
    change = np.abs(f(u * (1 + _ROUNDED * signs)) - a).max() / _ROUNDED
    return float(change) if math.isfinite(change) else 0.0


def _all_directions(
    by_u: _Derivative, by_v: _Derivative, u: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Both matrices in full, every column with an increment of its own: u may hold metres beside radians."""
    units = np.eye(u.size)
    K, C = (
        np.transpose([d.measure(w, abs(float(x[j])))[1] for j, w in enumerate(units)])
        for d, x in ((by_u, u), (by_v, v))
    )
    return K, C


def _fast_directions(by_u: _Derivative, by_v: _Derivative, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Both matrices on directions in which K and C are largest, and so is the combination that limits the step."""
    w = np.random.default_rng(2).standard_normal(n)
    (du, _), (dv, cw) = by_u.measure(w), by_v.measure(w)

    def k(w: np.ndarray) -> np.ndarray:
        return by_u(w, du)

    def c(w: np.ndarray) -> np.ndarray:
        return by_v(w, dv)

    stiff, H = _krylov_space(k, n)
    if not cw.any():
        return H, np.zeros_like(H)
    CV = np.array([c(w) for w in stiff])
    # Damping proportional to mass and stiffness stays within the space, but for the last direction, which leads out.
    if np.linalg.norm(CV[:-1] - (CV[:-1] @ stiff.T) @ stiff) <= _ROUND_OFF * np.linalg.norm(CV):
        m = max(1, len(stiff) - 1)
        return H[:m, :m], stiff[:m] @ CV[:m].T
    strong, G = _krylov_space(c, n)
    norms = _largest(H), _largest(G)
    both, _ = _krylov_space(lambda w: _combination(*norms, k(w), c(w)), n)
    V = _orthonormal(np.concatenate([part[: _DIRECTIONS // 2] for part in (stiff, strong, both)]))
    return V @ np.transpose([k(w) for w in V]), V @ np.transpose([c(w) for w in V])


def _largest(H: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(H)).max())


def _combination(k: float, c: float, K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """h^2 K + 3 h C for the step h with h^2 k + 3 h c = 4, near the stability limit.

    EIG-3's limit is set by the largest eigenvalue of such a sum with 4 in the place of 3, that of central difference
    with 0, or 2 where the velocity is lagged.
    """
    root = 3 * c + math.sqrt(9 * c * c + 16 * k)
    h = 8 / root if root > 0 else 1.0
    return h * h * K + 3 * h * C


def _krylov_space(apply: Callable, n: int) -> tuple[np.ndarray, np.ndarray]:
    """An orthonormal basis by Arnoldi's iteration, and the operator there.

    Where memory allows but few vectors, the iteration starts again from the best of what it found.
    """
    most = max(8, min(_DIRECTIONS, _VALUES // (3 * n)))
    w = np.random.default_rng(1).standard_normal(n)
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
        for _ in range(2):  # the second time for the sake of round-off
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
    """An orthonormal basis of the space that the rows span, without what is there by round-off only."""
    Q, R = np.linalg.qr(W.T)
    left, sizes, _ = np.linalg.svd(R)
    return (Q @ left[:, sizes > _ROUND_OFF * sizes[0]]).T
