"""Print the results of a parameter study, and write its files."""

from __future__ import annotations

import collections
import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..command_line import Files
from ..result.solution import Status
from . import pictures
from .study import Study


def report(study: Study, write: Callable[[str], None]) -> None:
    """Print the settings, the time and the measures of a study."""
    write(f"{study.problem.name}: {study.problem.source}")
    write("\n".join([*_settings(study), *_cost(study), *(f"  Note: {note}" for note in study.notes)]))
    write("\n".join(_table(study)))


def save(study: Study, out: Path, write: Callable[[str], None]) -> None:
    """Write sweep.csv, sweep.npz and, if matplotlib is installed, sweep.png."""
    files = Files(out, "eig3 sweep")
    with files.writing("sweep.csv") as path:
        _write_csv(study, path)
    with files.writing("sweep.npz") as path:
        np.savez_compressed(path, **_arrays(study))
    files.finish(write, files.draw("sweep.png", lambda figure: pictures.draw(figure, study)))


def _settings(study: Study) -> list[str]:
    (t0, t1), second = study.problem.t_span, study.problem.labels.second
    lines = [f"  {study.method!r}, h = {study.h:.6g}{second}, t = {t0:g} to {t1:g}{second}"]
    if study.after is not None:
        lines[0] += f", measured from {study.after:g}{second} on"
    for axis in study.axes:
        spread = f"{axis.count} values" if study.seed is None else f"random, seed {study.seed}"
        spread += ", logarithmic" if axis.is_log else ""
        lines.append(f"  {_with_unit(study, axis.name, f'{axis.low:g} to {axis.high:g}')}, {spread}")
    return lines + [f"  {_with_unit(study, name, f'{value:g}')}" for name, value in study.fixed.items()]


def _with_unit(study: Study, name: str, value: str) -> str:
    return f"{name} = {value} {study.parameters.unit(name, study.problem)}".rstrip()


def _cost(study: Study) -> list[str]:
    counts = collections.Counter(study.status.tolist())
    ended = ", ".join(f"{counts[status]} {status.value}" for status in Status if counts[status])
    missing = "" if counts[Status.COMPLETED] == len(study) else " (NaN in the files)"
    pace = 1e9 * study.kernels / max(1, study.n_steps)
    return [
        f"  {len(study)} members: {ended}{missing}",
        f"  {study.building:.3g} s to build the problems, {study.running:.3g} s to compile and run them",
        f"  {study.kernels:.3g} s in the kernels, summed over the threads ({pace:.3g} ns a step and member)",
    ]


def _table(study: Study) -> list[str]:
    errors = f" {'error at most':>14}" if study.errors else ""
    lines = [f"\n{'measure':24} {'min':>12} {'median':>12} {'max':>12}{errors}"]
    for measure in study.measures:
        values = study.values[str(measure)]
        finite = values[np.isfinite(values)]
        three = (finite.min(), np.median(finite), finite.max()) if finite.size else (np.nan,) * 3
        name = measure.with_unit(str(measure), study.problem)
        error = f" {np.fmax.reduce(study.errors[str(measure)]):14.2g}" if study.errors else ""
        lines.append(f"{name:24} " + " ".join(f"{value:12.6g}" for value in three) + error)
    return lines


def _write_csv(study: Study, path: Path) -> None:
    named = study.columns | study.values | _errors(study)
    columns, names = named.values(), [*named, "status"]
    with path.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")  # an output may have any name
        rows.writerow(names)
        for *row, status in zip(*(column.tolist() for column in columns), study.status.tolist(), strict=True):
            rows.writerow([*row, status.value])


def _arrays(study: Study) -> dict[str, Any]:
    """Return the arrays of the NPZ file: for a grid, the values along each axis, and the measures in its shape."""
    shape = study.shape
    status = np.array([status.value for status in study.status.tolist()])
    arrays = {**study.values, **_errors(study), "status": status}
    if study.seed is None:
        axes = {name: np.unique(column) for name, column in study.columns.items()}
        return {**axes, **{name: array.reshape(shape) for name, array in arrays.items()}}
    return {**study.columns, **arrays}


def _errors(study: Study) -> dict[str, np.ndarray]:
    return {f"error of {name}": values for name, values in study.errors.items()}
