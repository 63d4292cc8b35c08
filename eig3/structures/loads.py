"""Loads given as records: forces on some degrees of freedom, and ground motions."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..functions.checks import reals, shown
from ..functions.records import Records, Table
from ..functions.sparse import Sparse
from .matrices import check_masses

_RECORDS = ("ground_times", "ground"), ("force_times", "forces")


def check_ground(ground: Any, n: int) -> dict[str, Any]:
    """Return the parameters of a ground motion: times, accelerations and influences.

    Raises
    ------
    TypeError, ValueError
        If it is not (times, accelerations) or (times, accelerations, influence), or the shapes do not match.
    """
    wanted = "(times, accelerations) or (times, accelerations, influence)"
    times, values, *rest = _record(ground, "ground", wanted)
    if values.ndim != 1:
        raise ValueError(f"ground must have one acceleration for each time, not values of the shape {values.shape}.")
    influence = reals(rest[0] if rest else 1.0, "the influence of ground")
    influence = influence if influence.ndim else np.full(n, influence)
    if influence.shape != (n,) or not np.isfinite(influence).all():
        raise ValueError(f"the influence of ground must be {n} finite numbers, not of the shape {influence.shape}.")
    return {"ground_times": times, "ground": values, "influence": influence, "ground_scale": 1.0}


def check_table(force: Any, n: int) -> dict[str, Any]:
    """Return the parameters of forces given by a table: times, forces and their degrees of freedom.

    Raises
    ------
    TypeError, ValueError
        If it is not (times, forces) or (times, forces, degrees), or the shapes do not match.
    """
    wanted = "a jitted function f(t, u, v, p, out), or a table (times, forces) or (times, forces, degrees)"
    times, values, *rest = _record(force, "force", wanted)
    degrees = np.atleast_1d(np.asarray(rest[0])) if rest else np.arange(n)
    values = values[:, None] if values.ndim == 1 else values
    if degrees.dtype.kind not in "ui" or degrees.ndim != 1 or not ((degrees >= 0) & (degrees < n)).all():
        raise ValueError(
            f"the degrees of force must be whole numbers from 0 to {n - 1}: for a name, such as 'roof.ux', take "
            "names.index(name)."
        )
    if values.ndim != 2 or values.shape[1] != degrees.size:
        raise ValueError(
            f"force must have {degrees.size} values for each time, not values of the shape {values.shape}."
        )
    return {"force_times": times, "forces": values, "degrees": degrees.astype(np.int64), "force_scale": 1.0}


def sources(has: Mapping[str, Any]) -> list[str]:
    """Return the parameters from which others are computed: the factors of a mass, and modes for a damping."""
    names = ({"M"} if "inverse" in has else set()) | ({"K", "m", "M"} if "modes" in has else set())
    return sorted(names & {*has})


def checksum(has: Mapping[str, Any]) -> float:
    """Return a checksum of the sources. Of a sparse matrix, it takes the arrays."""
    values = [has[name] for name in sources(has)]
    arrays = [x for each in values for x in (each[:3] if isinstance(each, Sparse) else (each,))]
    return float(zlib.crc32(b"".join(np.asarray(x, dtype=float).tobytes() for x in arrays)))


def check_together(params: Any, n: int) -> None:
    """Check that the parameters of a structure, which a user has changed, belong together.

    Raises
    ------
    TypeError, ValueError
        If a record has not one value for each of its times, another array has another size than the structure needs, or
        a parameter from which others are computed has changed.
    """
    has = params._asdict()
    if has["size"] != n:
        raise ValueError(f"params are of a structure with {has['size']} degrees of freedom, and not {n}: make another.")
    if "ground" in has:
        check_ground((has["ground_times"], has["ground"], has["influence"]), n)
    if "forces" in has:
        check_table((has["force_times"], has["forces"], has["degrees"]), n)
    if "m" in has:
        check_masses(has["m"], "params['m']", n)
    for name in {"K", "C"} & {*has}:
        if tuple(has[name].shape) != (n, n):
            raise ValueError(f"params[{name!r}] must have the shape ({n}, {n}), not {tuple(has[name].shape)}.")
    if "checksum" in has and has["checksum"] != checksum(has):
        raise ValueError(
            f"params must keep {' and '.join(sources(has))}, because factors of M or modes of the damping are computed "
            "from them: make another problem with eig3.linear."
        )
    given = sum(len(values) for name, values in has.items() if re.fullmatch(r"link_\d+_first", name))
    if given != has.get("links", given):
        raise ValueError(
            f"params must keep the number of links, {has['links']}, not have {given}: make another problem."
        )
    for name, values in has.items():
        link = re.match(r"link_\d+_", name)
        count = len(has[f"{link[0]}first"]) if link else 0
        if link and len(values) != count:
            raise ValueError(
                f"params[{name!r}] must have a value for each of {count} links, not {len(values)}: an ensemble "
                f"takes the shape (members, {count}), such as values[:, None] for one link."
            )
        if link and name[link.end() :] in ("first", "second") and not ((values >= -1) & (values < n)).all():
            raise ValueError(f"params[{name!r}] must be numbers from 0 to {n - 1}, or -1 for the ground.")


def check_members(rows: np.ndarray, layout: Any, own: Sequence[str]) -> None:
    """Refuse own masses of members that are not positive, and own times of records that do not increase."""
    places = layout.places(layout.read(rows[0])._asdict())
    for name in sorted({"m", *(times for times, _ in _RECORDS)} & {*own}):
        values = rows[:, places[name]]
        good = (values > 0).all(axis=1) if name == "m" else (np.diff(values) > 0).all(axis=1)
        if not good.all():
            rule = "be positive" if name == "m" else "increase"
            raise ValueError(f"params[{name!r}] must {rule}, but the values of member {good.argmin()} do not.")


def tables(rows: np.ndarray, layout: Any) -> list[Table]:
    """Return the records in the parameters of members; see `Records`."""
    first = layout.read(rows[0])._asdict()
    places = layout.places(first)
    return [
        tuple(rows[:, places[name]].reshape(-1, *np.shape(first[name])) for name in names)  # type: ignore[misc]
        for names in _RECORDS
        if names[0] in first
    ]


#: What the right-hand side of a structure knows of its parameters.
RECORDS = Records(
    tables,
    tuple(name for names in _RECORDS for name in names),
    check_together,
    {"checksum": ("K", "m", "M")},
    check_members=check_members,
)


def _record(given: Any, name: str, wanted: str) -> tuple:
    """Return the times and the values of a record as arrays, and further entries unchanged."""
    if not (isinstance(given, tuple | list) and len(given) in (2, 3)):
        raise TypeError(f"{name} must be {wanted}, not {shown(given)}.")
    t, x = reals(given[0], f"the times of {name}"), reals(given[1], name)
    if t.ndim != 1 or t.size < 2 or not (np.isfinite(t).all() and (np.diff(t) > 0).all()):
        raise ValueError(f"the times of {name} must be two or more finite numbers that increase.")
    if x.ndim == 0 or len(x) != t.size or not np.isfinite(x).all():
        raise ValueError(f"{name} must have a finite value for each of its {t.size} times.")
    return (t, x, *given[2:])
