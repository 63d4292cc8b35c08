"""Checks of the arguments, before anything runs. Each error names the argument and says what it must be."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.protocol import SCALAR, VECTOR, Form
from ..methods import METHODS, Method, named, nearest, shown

_NEVER_REACHED = 2**62
_PLAIN = float, int
_FLOAT64 = np.dtype(np.float64)
_NO_PARAMS = np.empty(0)


def check_state(u0: Any, v0: Any) -> tuple[Any, Any, Form]:
    """Return u0 and v0 as two floats or two new arrays, and the matching form of the right-hand side."""
    if type(u0) is float and type(v0) is float and math.isfinite(u0) and math.isfinite(v0):
        return u0, v0, SCALAR
    is_array = type(u0) is np.ndarray and type(v0) is np.ndarray
    are_rows = is_array and u0.dtype == v0.dtype == _FLOAT64 and u0.ndim == v0.ndim == 1 and 0 < u0.size == v0.size
    # For few values, a search in bytes takes a third of the time of np.all.
    if are_rows and 0 not in np.isfinite(u0).tobytes() and 0 not in np.isfinite(v0).tobytes():
        return u0.copy(), v0.copy(), VECTOR
    u, v = reals(u0, "u0"), reals(v0, "v0")
    if u.ndim > 1:
        raise ValueError(f"u0 must be a number or a 1-D array, not an array of shape {u.shape}.")
    if u.shape != v.shape:
        raise ValueError(f"u0 and v0 must have the same shape, not {u.shape} and {v.shape}.")
    if u.size == 0:
        raise ValueError("u0 must hold at least one degree of freedom, but it is empty.")
    for name, array in (("u0", u), ("v0", v)):
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite, but it holds {array[~np.isfinite(array)].flat[0]}.")
    return (float(u), float(v), SCALAR) if u.ndim == 0 else (u, v, VECTOR)


def check_params(params: ArrayLike) -> np.ndarray:
    """Return the parameters as a 1-D array of float64, which may be `params` itself and must not be changed."""
    if type(params) is np.ndarray and params.dtype == _FLOAT64 and params.ndim == 1:
        return params
    if type(params) is tuple and not params:
        return _NO_PARAMS
    p = reals(params, "params")
    p = p if p.ndim else p.reshape(1)
    if p.ndim > 1:
        raise ValueError(f"params must be a number or a 1-D sequence, not an array of shape {p.shape}.")
    return p


def check_span(t_span: Sequence[float]) -> tuple[float, float]:
    """Return the first and the last time of the span as floats."""
    if type(t_span) is tuple and len(t_span) == 2 and type(t_span[0]) in _PLAIN and type(t_span[1]) in _PLAIN:
        t0, t1 = float(t_span[0]), float(t_span[1])
    else:
        ends = reals(t_span, "t_span")
        if ends.shape != (2,):
            raise ValueError(f"t_span must be the two times (t0, t1), not {shown(t_span)}.")
        t0, t1 = ends.tolist()
    if not (math.isfinite(t0) and math.isfinite(t1)):
        raise ValueError(f"t_span must be finite, not ({t0}, {t1}).")
    if not t1 > t0:
        back = (
            f": to go back in time, integrate f(-t, u, -v) over ({0 - t0}, {0 - t1}) from u0 and -v0" if t1 < t0 else ""
        )
        raise ValueError(f"t_span must end after it starts, but it is ({t0}, {t1}){back}.")
    if not math.isfinite(t1 - t0):
        raise ValueError(f"t_span must have a finite length, but it is ({t0}, {t1}).")
    return t0, t1


def check_time(t: float, name: str) -> float:
    """Return a finite time as a float."""
    time = t if type(t) is float else reals(t, name)
    if np.ndim(time) != 0 or not math.isfinite(time):
        raise ValueError(f"{name} must be a finite number, not {shown(t)}.")
    return float(time)


def check_h(h: float, name: str = "h") -> float:
    """Return a step, which must be positive and finite, as a float."""
    step = h if type(h) is float else reals(h, name)
    if np.ndim(step) != 0 or not (math.isfinite(step) and step > 0):
        raise ValueError(f"{name} must be a positive, finite number of time units, not {shown(h)}.")
    return float(step)


def check_resolution(h: float, t0: float, t1: float) -> None:
    """Refuse a step that is shorter than four units in the last place of the largest time."""
    least = 4 * np.spacing(max(abs(t0), abs(t1)))
    if h < least:
        raise ValueError(f"h must be at least {least:.3g} for floating-point times up to {max(t0, t1):g}, not {h:g}.")


def check_count(value: Any, name: str) -> int:
    """Return a whole number of at least 1 as an int.

    A number beyond 64 bits becomes a smaller number that no count reaches either.
    """
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)
    if not is_whole or value < 1:
        raise ValueError(f"{name} must be a whole number of at least 1, not {shown(value)}.")
    return min(int(value), _NEVER_REACHED)


def check_index(value: Any) -> int:
    """Return the number of steps taken, a whole number that is not negative."""
    return 0 if value == 0 else check_count(value, "the number of steps")


def check_flag(value: Any, name: str) -> bool:
    """Return True or False. Other values are refused, because the text "False" would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, not {shown(value)}.")
    return bool(value)


def check_names(names: Iterable[Any], argument: str) -> None:
    """Refuse names that are not strings."""
    for name in names:
        if not isinstance(name, str):
            raise TypeError(f"the names in {argument} must be strings, not {shown(name)}.")


def distinct(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return the values by name, and refuse equal names, because an output may have any name."""
    found: dict[str, Any] = {}
    for name, value in values:
        if name in found:
            raise ValueError(f"{name} is the name of two columns: rename the output, integral or degree of freedom.")
        found[name] = value
    return found


def check_cancel(cancel: Any) -> Any:
    """Return the event that cancels a run, or None."""
    if cancel is not None and not callable(getattr(cancel, "is_set", None)):
        raise TypeError(f"cancel must be a threading.Event, not {shown(cancel)}.")
    return cancel


def check_method(method: str | Method, *, has_tolerances: bool = False) -> Method:
    """Return the record of a method, which is given by its name or label, as a record, or as a record's class."""
    found = named(method) if isinstance(method, str) else None
    if found:
        record, needs_tolerances = found
        if needs_tolerances and not has_tolerances:
            raise ValueError(
                f"method {shown(method)} belongs to a run with tolerances: give rtol in place of h, or "
                f"method={_default(record).name!r} for a fixed step."
            )
        return _default(record)
    if isinstance(method, Method) and type(method) is not Method:
        return method
    if method is not Method and isinstance(method, type) and issubclass(method, Method):
        return _default(method)  # type: ignore[arg-type]
    near = nearest(method) if isinstance(method, str) else []
    raise ValueError(
        f"method must be one of {', '.join(map(repr, METHODS))} or a record such as EIG3(), not {shown(method)}"
        f"{': did you mean ' if near else ''}{' or '.join(map(repr, near))}{'?' if near else '.'}"
    )


def velocity_refused(method: Method) -> ValueError:
    """Return the error of a method that ignores the velocity, for a right-hand side that reads it."""
    if hasattr(method, "velocity"):
        return ValueError("velocity='none' needs a rhs that ignores v, and this one does not; leave it out.")
    return ValueError(
        f"{method!r} needs a rhs that ignores v and has no z0; take another method, or leave out what reads v, such "
        "as drag, dampers and friction."
    )


@functools.cache
def _default(record: type[Method]) -> Method:
    return record()


def reals(value: Any, name: str) -> np.ndarray:
    """Return a new C-contiguous array of float64; `name` is the name of the argument in errors."""
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "buif" or (isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value)):
            raise TypeError
        return np.array(array, dtype=np.float64, order="C")
    except ValueError:
        raise TypeError(
            f"{name} must be made of real numbers, not {shown(value)} with rows of other lengths."
        ) from None
    except TypeError:
        raise TypeError(f"{name} must be made of real numbers, not {shown(value)}.") from None
