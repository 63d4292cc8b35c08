"""An ensemble that runs in parts, and continues from the parts that are in its directory."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..functions.checks import check_cancel, check_count
from ..kernels.compile.interrupt import with_solution
from ..result import storage
from ..run.progress import check_progress
from ..stepping.march import Cancel
from ..stepping.run_options import RunOptions
from ..stepping.threads import cores
from .files import WHOLE, Directory, recipe_in, whole_in, with_error
from .in_process import EnsembleRun, at_start
from .members import Members
from .parts import Joined, Listed, Results, parts_of
from .recipe import differing, marks, restored
from .shipping import check_executor, march_parts
from .single_members import Singles
from .solution import EnsembleSolution, Reduce
from .step_notes import step_notes


def run_in_parts(
    rhs: Any,
    members: Members,
    options: RunOptions,
    reduce: Reduce | None,
    place: Directory | None,
    executor: Executor | None,
    threads: tuple[int, int],
    progress: bool,
    cancel: Cancel | None,
) -> Any:
    """Run an ensemble in parts; `threads` are the numbers of threads of a part in this process, and on a worker.

    The parts in the directory do not run again.
    """
    parts = left = parts_of(members, options)
    results: Results = Listed(parts)
    if reduce is None:
        start = at_start(rhs, members, options)
        start._resume = partial(_resumed, rhs, members, options, place) if place else None
        results = joined = Joined(start, place)
        left = joined.left(parts)
    march = partial(_march if reduce is None else _march_with_notes, rhs, options)
    found = march_parts(left, march, reduce, results, executor, threads, progress, cancel)
    if reduce is None:
        notes = step_notes(found, Singles(rhs, members, options), members, options)
        found.notes += notes
        if place:
            place.keep_notes(options.method, notes)
    return found


def _march(rhs: Any, options: RunOptions, members: Members, threads: int, cancel: Cancel | None) -> EnsembleSolution:
    return EnsembleRun(rhs, members, options, threads, is_part=True).march(cancel=cancel)


def _march_with_notes(
    rhs: Any, options: RunOptions, members: Members, threads: int, cancel: Cancel | None
) -> EnsembleSolution:
    """Run a part whose result nothing joins with the others."""
    solution = _march(rhs, options, members, threads, cancel)
    solution.notes += step_notes(solution, Singles(rhs, members, options), members, options)
    return solution


@with_solution
def _resumed(
    rhs: Any,
    members: Members,
    options: RunOptions,
    place: Directory,
    threads: int | None,
    executor: Executor | None,
    progress: bool,
    cancel: Cancel | None,
) -> EnsembleSolution:
    """Run the unfinished parts, as `EnsembleSolution.resume` describes."""
    check_progress(progress)
    check_executor(executor)
    check_cancel(cancel)
    own = cores() if threads is None else check_count(threads, "threads")
    of_parts = own, threads or 1
    solution = run_in_parts(rhs, members, options, None, place, executor, of_parts, progress, cancel)
    return with_error(solution, place.path)


def _loaded(path: Path) -> EnsembleSolution:
    """Return the ensemble in a directory, which can continue with its functions."""
    solution = whole_in(path)
    if recipe_in(path):
        solution._with_functions = partial(_of_functions, path)
    return solution


def _of_functions(
    path: Path, params: np.ndarray, rhs: Any, given: Mapping[str, Any], **options: Any
) -> EnsembleSolution:
    """Run the unfinished parts of the ensemble in a directory, with its functions."""
    recipe = recipe_in(path)
    run = restored(recipe, params, rhs, given)
    if names := differing(marks(*run), recipe["marks"]):
        raise ValueError(
            f"{path} holds an ensemble with another {' and another '.join(names)}: load it with the functions of the "
            "ensemble."
        )
    return _resumed(*run, Directory(path, recipe), **options)


storage.DIRECTORIES[WHOLE] = _loaded
