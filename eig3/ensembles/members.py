"""The members of an ensemble: their start, their parameters and their steps, from arguments that are broadcast."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import form_of
from ..functions.checks import check_h, check_resolution, check_span, reals
from ..kernels.protocol import SCALAR, VECTOR, Form
from ..run.fixed_run import divide

_WHOLE = 1e-12  # largest relative difference of a number of steps from a whole number


@dataclass(frozen=True)
class Members:
    """The members of an ensemble, or some of them.

    Attributes
    ----------
    form : Form
    t_span : (float, float)
    u0, v0 : ndarray, shape (m, n)
        n is 1 in the scalar form.
    params : ndarray, shape (m, k) or (k,)
        One set for each member, or one for all.
    h : float or ndarray, shape (m,)
        The step, or one for each member. It divides the span. NaN with tolerances.
    n_steps : ndarray, shape (m,)
        Number of steps; 0 with tolerances.
    first : int
        The number of the first member in the whole ensemble.
    own : tuple of str
        The names of the parameters with a value for each member; empty if they are not known.
    """

    form: Form
    t_span: tuple[float, float]
    u0: np.ndarray
    v0: np.ndarray
    params: np.ndarray
    h: Any
    n_steps: np.ndarray
    first: int = 0
    own: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.u0)

    @property
    def n(self) -> int:
        """Number of degrees of freedom of a member."""
        return self.u0.shape[1]

    @property
    def has_own_params(self) -> bool:
        """Whether each member has its own parameters."""
        return self.params.ndim == 2

    @property
    def has_own_step(self) -> bool:
        """Whether each member has its own step."""
        return np.ndim(self.h) == 1

    @property
    def steps(self) -> np.ndarray:
        """The step of each member, shape (m,)."""
        return np.broadcast_to(self.h, len(self))

    def part(self, chosen: slice) -> Members:
        """Return some of the members."""
        return replace(
            self,
            u0=self.u0[chosen],
            v0=self.v0[chosen],
            params=self.params[chosen] if self.has_own_params else self.params,
            h=self.h[chosen] if self.has_own_step else self.h,
            n_steps=self.n_steps[chosen],
            first=self.first + chosen.start,
        )

    def start(self, i: int) -> tuple[Any, Any, np.ndarray]:
        """Return u0, v0 and the parameters of member i."""
        u, v = (float(x[i, 0]) if self.form is SCALAR else x[i] for x in (self.u0, self.v0))
        return u, v, self.params[i] if self.has_own_params else self.params

    def until(self, t_end: float) -> Members:
        """Return the members with a later end, and with the same steps.

        Raises
        ------
        ValueError
            If t_end is not a whole number of steps from the start of each member.
        """
        t0 = self.t_span[0]
        if not t_end > self.t_span[1]:
            raise ValueError(f"t_end must be later than the end of the run at t = {self.t_span[1]:g}, not {t_end:g}.")
        if np.isnan(self.h).any():
            return replace(self, t_span=(t0, t_end))
        n_steps = np.maximum(self.n_steps + 1, np.round((t_end - t0) / self.steps))
        nearest = t0 + n_steps * self.steps
        distance = np.abs(nearest - t_end) - _WHOLE * n_steps * self.steps
        i = int(np.argmax(distance))
        if distance[i] > 2 * np.spacing(max(abs(t0), abs(t_end))):
            raise ValueError(
                f"t_end must be a whole number of steps h = {float(self.steps[i])!r} after the end of the run, "
                f"not {t_end!r}; take t_end={float(nearest[i])!r}."
            )
        return replace(self, t_span=(t0, t_end), n_steps=n_steps.astype(np.int64))


def check_members(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    params: ArrayLike,
    h: ArrayLike | None,
    own: tuple[str, ...] = (),
) -> Members:
    """Broadcast the arguments of `ensemble` over its members; h is None with tolerances.

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid, or the shapes of two arguments do not match.
    """
    t0, t1 = check_span(t_span)
    form = form_of(rhs)
    inner = 0 if form is SCALAR else 1
    given = {"u0": (reals(u0, "u0"), inner), "v0": (reals(v0, "v0"), inner)}
    given["params"] = np.atleast_1d(reals(params, "params")), 1
    if h is not None:
        given["h"] = reals(h, "h"), 0
    m = _count(given, form)
    arrays = {name: array for name, (array, _) in given.items()}
    if form is VECTOR and arrays["u0"].shape[-1] != arrays["v0"].shape[-1]:
        raise _clash("u0", arrays["u0"], "v0", arrays["v0"], "their last axes are the degrees of freedom")
    for name in ("u0", "v0"):
        if not np.isfinite(arrays[name]).all():
            bad = int(np.argmin(np.isfinite(arrays[name]).reshape(len(np.atleast_1d(arrays[name])), -1).all(axis=1)))
            raise ValueError(f"{name} must be finite, but {name}[{bad}] is not.")
    n = 1 if form is SCALAR else arrays["u0"].shape[-1]
    if n == 0:
        raise ValueError("u0 must hold at least one degree of freedom, but it is empty.")
    u, v = (np.broadcast_to(x[..., None] if form is SCALAR else x, (m, n)) for x in (arrays["u0"], arrays["v0"]))
    p = _of_all(arrays["params"], 1, m)
    steps, n_steps = (math.nan, 0) if h is None else _divided(_of_all(arrays["h"], 0, m), t0, t1)
    return Members(form, (t0, t1), u, v, p, steps, np.broadcast_to(n_steps, m), own=own)


def _count(given: dict[str, tuple[np.ndarray, int]], form: Form) -> int:
    """Return the number of members, after a check of all shapes."""
    m, first = 1, ""
    for name, (array, inner) in given.items():
        if array.ndim < inner or array.ndim > inner + 1:
            shapes = {("h", 0): "() or (m,)", ("params", 1): "(k,) or (m, k)"}
            wanted = shapes.get((name, inner), "() or (m,)" if inner == 0 else "(n,) or (m, n)")
            raise ValueError(
                f"{name} must have the shape {wanted} for m members of the {form.name} form, not {array.shape}."
            )
        if array.ndim == inner or len(array) == 1:
            continue
        if len(array) == 0:
            raise ValueError(f"{name} must hold at least one member, but it is empty.")
        if first and len(array) != m:
            raise _clash(first, given[first][0], name, array, "their first axes are the members")
        m, first = len(array), first or name
    if not first and not any(array.ndim > inner for array, inner in given.values()):
        raise ValueError(
            "u0, v0, params or h must have a first axis of members, such as params of shape (m, k); "
            "for a single trajectory call eig3.integrate."
        )
    params = given["params"][0]
    if params.ndim == 1 and params.size == m > 1:
        raise ValueError(
            f"params has the shape ({m},) for {m} members: write params[:, None] for one parameter a member, or "
            f"params[None, :] for the same {m} parameters in all of them."
        )
    return m


def _of_all(array: np.ndarray, inner: int, m: int) -> np.ndarray:
    """Return an argument without its first axis if it has one value for all of several members.

    rhs is compiled for shared values or for values of each member. The choice must not depend on the number of members,
    because the compiler may fuse different multiply-adds: the value of a single member keeps its first axis.
    """
    return array[0] if array.ndim > inner and len(array) == 1 < m else array


def _clash(first: str, one: np.ndarray, second: str, other: np.ndarray, rule: str) -> ValueError:
    return ValueError(f"{first} has the shape {one.shape} and {second} the shape {other.shape}, but {rule}.")


def _divided(h: np.ndarray, t0: float, t1: float) -> tuple[Any, Any]:
    """Return steps that divide the span, and their numbers, as `divide` does for one step."""
    valid = np.isfinite(h) & (h > 0)
    if not valid.all():
        check_h(float(h[~valid].flat[0]))
    span = t1 - t0
    divide(t0, t1, float(h.min()))  # this refuses numbers of steps that are too large to count
    ratio = span / h
    nearest = np.round(ratio)
    round_off = math.ulp(max(abs(t0), abs(t1))) / h
    is_whole = np.abs(ratio - nearest) <= np.maximum(_WHOLE * np.maximum(ratio, nearest), round_off)
    n_steps = np.maximum(1, np.where(is_whole, nearest, np.ceil(ratio))).astype(np.int64)
    check_resolution(float((span / n_steps).min()), t0, t1)
    return (span / n_steps, n_steps) if h.ndim else (span / int(n_steps), int(n_steps))
