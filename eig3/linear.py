"""A system about a state, u'' = -K u - C v, on the few directions in which it is fastest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_FULL = 64  # degrees of freedom up to which all directions are taken
_DIRECTIONS = 60  # of a force without velocity; of one with, half of them for each of three operators
_VALUES = 2**25  # of all the vectors kept: 256 MB
_INCREMENT = 2.0**-26  # of u or v, relatively: balances truncation against round-off
_NEGLIGIBLE = 1e-10  # what differences leave of a vector within the space spanned


@dataclass(frozen=True)
class Linearised:
    """-df/du and -df/dv at a state.

    Attributes
    ----------
    K, C : ndarray, shape (m, m)
        On m orthonormal directions: all of them in a system of up to 64 degrees of freedom, else those of Krylov
        spaces, in which the highest frequencies and the strongest dampings of the whole are met closely.
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


class _Derivatives:
    """Products of -df/du and -df/dv with vectors, by differences of f."""

    def __init__(self, f: Callable, t: float, u: Any, v: Any) -> None:
        self._f, self._t, self._shape = f, t, np.shape(u)
        self.n = int(np.size(u))
        self._u, self._v = np.atleast_1d(u), np.atleast_1d(v)
        self.evaluations = 0
        self._at_rest = self._evaluate(self._u, self._v)
        self._scales = [float(np.abs(x).max()) or 1.0 for x in (self._u, self._v)]
        w = np.random.default_rng(2).standard_normal(self.n)
        self.has_velocity = bool(np.any(self.c(w)))

    def k(self, w: np.ndarray) -> np.ndarray:
        dw = self._increment(w, self._scales[0])
        return self._difference(self._evaluate(self._u + dw * w, self._v), dw, "u")

    def c(self, w: np.ndarray) -> np.ndarray:
        dw = self._increment(w, self._scales[1])
        return self._difference(self._evaluate(self._u, self._v + dw * w), dw, "v")

    def _increment(self, w: np.ndarray, scale: float) -> float:
        return _INCREMENT * scale / float(np.abs(w).max())

    def _difference(self, a: np.ndarray, dw: float, name: str) -> np.ndarray:
        change = (self._at_rest - a) / dw
        if not np.isfinite(change).all():
            raise ValueError(f"rhs is not finite close to this state ({name} changed by some 1e-8 of its size).")
        return change

    def _evaluate(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        if self._shape == ():
            return np.atleast_1d(self._f(self._t, float(u[0]), float(v[0])))
        return self._f(self._t, u, v)


def linearise(f: Callable, t: float, u: Any, v: Any) -> Linearised:
    """Linearise ``f(t, u, v)`` at a state, without ever holding a matrix of its size.

    Raises
    ------
    ValueError
        Where f is not finite close to the state.
    """
    d = _Derivatives(f, t, u, v)
    V = np.eye(d.n) if d.n <= _FULL else _fast_directions(d)
    K = V @ np.transpose([d.k(w) for w in V])
    C = V @ np.transpose([d.c(w) for w in V]) if d.has_velocity else np.zeros_like(K)
    return Linearised(K, C, d.evaluations)


def _fast_directions(d: _Derivatives) -> np.ndarray:
    """Orthonormal directions in which K and C are largest, and so is the combination of both that limits the step."""
    most = max(8, min(_DIRECTIONS, _VALUES // (2 * d.n)))
    if not d.has_velocity:
        return _krylov_space(d.k, d.n, most)[0]
    stiff, k = _krylov_space(d.k, d.n, most // 2)
    strong, c = _krylov_space(d.c, d.n, most // 2)
    both, _ = _krylov_space(lambda w: _combination(k, c, d.k(w), d.c(w)), d.n, most // 2)
    return _orthonormal(np.concatenate([stiff, strong, both]))


def _combination(k: float, c: float, K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """h^2 K + 3 h C for the step h with h^2 k + 3 h c = 4, near the stability limit.

    EIG-3's limit is set by the largest eigenvalue of such a sum with 4 in the place of 3, that of central difference
    with 0, or 2 where the velocity is lagged.
    """
    root = 3 * c + math.sqrt(9 * c * c + 16 * k)
    h = 8 / root if root > 0 else 1.0
    return h * h * K + 3 * h * C


def _krylov_space(apply: Callable, n: int, most: int) -> tuple[np.ndarray, float]:
    """An orthonormal basis by Arnoldi's iteration, and the largest absolute eigenvalue there."""
    V, H = np.empty((most, n)), np.zeros((most, most))
    w = np.random.default_rng(1).standard_normal(n)
    V[0] = w / np.linalg.norm(w)
    for j in range(most):
        w = apply(V[j])
        before = np.linalg.norm(w)
        for _ in range(2):  # the second time for the sake of round-off
            along = V[: j + 1] @ w
            H[: j + 1, j] += along
            w = w - along @ V[: j + 1]
        after = np.linalg.norm(w)
        if not after > _NEGLIGIBLE * before or j + 1 == most:
            break
        H[j + 1, j] = after
        V[j + 1] = w / after
    return V[: j + 1], float(np.abs(np.linalg.eigvals(H[: j + 1, : j + 1])).max())


def _orthonormal(W: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the space that the rows span, without what is there by round-off only."""
    sizes, mixtures = np.linalg.eigh(W @ W.T)
    kept = sizes > _NEGLIGIBLE * sizes[-1]
    return (mixtures[:, kept] / np.sqrt(sizes[kept])).T @ W
