"""Measure what each accuracy costs in time on a set of problems, beside rivals, and write a page of it.

The numbers are kept in JSON files as soon as they are measured. --resume continues a run that was cut off, and
--from draws the page again without measuring.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from eig3.command_line import Files, add_methods, add_out, count, folder
from eig3.functions.checks import check_method
from eig3.keywords import with_suggestions
from eig3.methods import LIBRARY, shown
from eig3.named_problem import is_own
from eig3.problem import Problem

from .. import c
from ..choices import add_accuracies, choose
from ..environment import environment, in_words
from ..modes import MODES
from ..problem_set import PROBLEM_SET, VARIABLE_SPEED
from ..rivals import RIVALS
from ..typed import checked
from . import own_problem
from .comparison import Comparison
from .markdown import draw_pictures
from .markdown import page as markdown_page
from .page import html
from .parts import COMMAND, Part, Settings, command_line, measure_own, parts_of
from .record import RUN, Record, RecordError, part_name

SUMMARY = "everything on one page"
_DEFAULTS = Settings()
_PACKAGES = ("matplotlib", "scipy", "markdown", "jinja2", "vl_convert")  # that a page needs


def add_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--problem",
        dest="problems",
        action="append",
        metavar="NAME",
        help="only this one, or your own as module:name; may be repeated",
    )
    add_methods(parser)
    add("--repeats", type=count, help=f"runs for each median ({_DEFAULTS.repeats})")
    add("--longest", type=float, metavar="S", help=f"halve the steps until a run takes this time ({_DEFAULTS.longest})")
    add("--mode", dest="modes", action="append", choices=MODES, help="only this mode; may be repeated")
    add(
        "--no-rivals", dest="rivals", action="store_false", default=None, help="leave out the solvers of other packages"
    )
    add_accuracies(parser, "1e-1 to 1e-10, or 1e-2, 1e-4, 1e-6 and 1e-8 for your own problem")
    add_out(parser, "folder for the numbers and the page")
    add("--resume", action="store_true", help="continue the run in the folder of --out")
    add("--from", dest="source", type=Path, metavar="DIR", help="draw the page of the run in DIR, without measuring")
    add("--against", type=Path, metavar="DIR", help="compare with the run in DIR")


def run(options: argparse.Namespace) -> None:
    given = {name: value for name in asdict(_DEFAULTS) if (value := getattr(options, name)) is not None}
    _check_packages(COMMAND, SystemExit)
    try:
        if options.source is not None:
            _draw_again(options, given)
        else:
            _measure(options, given)
    except RecordError as error:
        raise SystemExit(f"{COMMAND}: {error}") from None


def _draw_again(options: argparse.Namespace, given: Mapping[str, Any]) -> None:
    if given or options.resume:
        raise SystemExit(f"{COMMAND}: --from only draws what was measured: leave out the options of a measurement.")
    record = Record.open(options.source)
    draw(record, options.out or options.source, _against(record, options.against), print)


def _measure(options: argparse.Namespace, given: Mapping[str, Any]) -> None:
    if options.out is None:
        raise SystemExit(f"{COMMAND}: give --out DIR to measure, or --from DIR to draw a page again.")
    if options.against is not None:
        Record.open(options.against)  # a folder without a run is an error now, and not after the measurement
    settings = _settings(options, given)
    parts = parts_of(settings)
    if any(part.name == "c" for part in parts):
        c.build_all()  # a compiler that fails ends the report here, and not after minutes of measuring
    if options.resume:
        record = Record.open(options.out)
        _check_same_machine(record)
    else:
        record = Record.create(
            options.out, command_line(options.out, given), asdict(settings), [part.name for part in parts]
        )
    draw(record, options.out, None, _silently)  # a page that cannot be written is an error now too
    try:
        complete(record, parts, print)
    except (KeyboardInterrupt, SystemExit):
        draw(record, options.out, _against(record, options.against), print)
        print(f"{len(record.missing)} parts are not measured: {COMMAND} --out {options.out} --resume continues.")
        raise
    draw(record, options.out, _against(record, options.against), print)


def _settings(options: argparse.Namespace, given: Mapping[str, Any]) -> Settings:
    """What to measure, from the options or, with --resume, from the run that continues."""
    has_run = (options.out / RUN).exists()
    if has_run and not options.resume:
        raise SystemExit(
            f"{COMMAND}: {options.out} holds a run: continue it with --resume, draw its page by --from, or choose "
            "another folder."
        )
    if options.resume:
        known = _known(Record.open(options.out))
        for name, value in given.items():
            if value != getattr(known, name):
                raise SystemExit(
                    f"{COMMAND}: --resume continues with the options of the run, in which {name} is "
                    f"{getattr(known, name)}, not {value}: leave the option out, or choose another folder."
                )
        _check_names(known)
        return known
    settings = replace(_DEFAULTS, **given)
    _check_names(settings)
    return settings


def _known(record: Record) -> Settings:
    try:
        return checked(Settings(**record.run.settings))
    except TypeError:
        raise RecordError(f"{record.folder / RUN} has settings of another version: choose another folder.") from None


def _check_names(settings: Settings) -> None:
    """Refuse names that are not known, and load the user's own problems."""
    _check_files(settings.problems or ())
    for name in settings.problems or ():
        if is_own(name):
            own_problem.load(name)
        else:
            choose([name], [*PROBLEM_SET, *VARIABLE_SPEED, "your own as module:name"], "--problem")
    choose(settings.methods, list(LIBRARY))


def _check_files(problems: Sequence[str]) -> None:
    """Refuse two problems whose parts have the same name."""
    names: dict[str, str] = {}
    for name in problems:
        other = names.setdefault(part_name("precision", name), name)
        if other != name:
            raise SystemExit(
                f"{COMMAND}: --problem {other} and --problem {name} would be kept in the same files: measure them in "
                "two folders."
            )


def _check_packages(who: str, error: type[BaseException]) -> None:
    missing = [package for package in _PACKAGES if importlib.util.find_spec(package) is None]
    if missing:
        raise error(f"{who} needs {', '.join(missing)}: install what it needs with pip install 'eig3[bench]'.")


def _check_same_machine(record: Record) -> None:
    if record.run.environment != environment():
        raise SystemExit(
            f"{COMMAND}: {record.folder} was measured on {in_words(record.run.environment)}, but this is {in_words()}: "
            "times of both do not belong together; choose another folder."
        )


def _silently(line: str) -> None:
    pass


def _against(record: Record, folder: Path | None) -> Comparison | None:
    return None if folder is None else Comparison.of(record, Record.open(folder))


def complete(record: Record, parts: Sequence[Part], write: Callable[[str], None]) -> None:
    """Measure the parts that are missing, and keep each as soon as it is complete."""
    for part in parts:
        if part.name in record.missing:
            begin = time.perf_counter()
            data = part.measure(record)
            seconds = time.perf_counter() - begin
            record.keep(part.name, part.command, seconds, data)
            write(f"{part.name}: {seconds:.0f} s")


def draw(record: Record, out: Path, comparison: Comparison | None, write: Callable[[str], None]) -> None:
    """Write the page, as HTML and as Markdown with pictures, into the folder `out`."""
    files = Files(out, COMMAND)
    draw_pictures(record, files)
    for result in record.results if out != record.folder else ():
        motion = record.motion(result.name)
        if motion:
            with files.writing(motion.name) as path:
                path.write_bytes(motion.read_bytes())
    for name, page in (("report.md", markdown_page), ("report.html", html)):
        with files.writing(name) as path:
            path.write_text(page(record, comparison), encoding="utf-8")
    if comparison:
        write(comparison.summary)
    files.finish(write)


@with_suggestions()
def report(
    problem: Problem,
    out: str | os.PathLike[str] = "report",
    accuracies: Sequence[float] = own_problem.ACCURACIES,
    rivals: bool | Sequence[str] = True,
    repeats: int = _DEFAULTS.repeats,
    methods: Sequence[str] | None = None,
) -> Path:
    """Measure what each accuracy costs in time on your own problem, and write a page of it.

    The methods and their steps follow from pilot runs of `eig3.plan`. They run with the right-hand side through a
    pointer, the fastest of them also with it inlined, and beside other solvers. Whole calls are timed, and kernels
    alone. This takes about a minute for a small system.

    Parameters
    ----------
    problem : Problem
        Its events with `apply` are followed. A terminal event is refused.
    out : path
        The folder for the page and its numbers. An older report there is replaced.
    accuracies : sequence of float
        The relative errors of the trajectory and, if the problem has one, of the energy, between 0 and 1.
    rivals : bool or sequence of str
        Whether to measure other solvers, as far as they are installed, or which of "scipy dop853", "scipy rk45",
        "scipy lsoda", "cyrk dop853" and "cyrk vern8".
    repeats : int
        Runs for each median.
    methods : sequence of str, optional
        The names of the methods to measure, also of your own, such as ``["yoshida4", "cd", "rk4"]``; by default the
        ones that the plan finds fast.

    Returns
    -------
    Path
        The page, report.html. Beside it are report.md with pictures, and the numbers as JSON.

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid, or if no run of the problem reaches the end of its span.
    ImportError
        If one of the packages that a page needs is not installed.
    OSError
        If `out` cannot be written.

    Notes
    -----
    Errors are measured against `problem.exact`, or else against RK8 with steps that are halved until two runs agree to
    a tenth of the smallest accuracy. No accuracy below three times this difference is claimed for a method.
    """
    own_problem.check(problem)
    settings = _own_settings(problem, accuracies, rivals, repeats, methods)
    _check_packages("eig3.report", ImportError)
    name, changed = problem.name, settings.changed
    given = {"accuracies": tuple(changed.pop("accuracies")), **changed}
    arguments = [name, *(f"{key}={value!r}" for key, value in given.items() if key != "problems")]
    command = f"eig3.report({', '.join(arguments)})"
    part = Part(part_name("precision", name), command, lambda record: measure_own(record, name, problem, "", settings))
    with _os_error():
        place = folder(os.fspath(out))
        record = Record.create(place, command, asdict(settings), [part.name])
        complete(record, [part], _silently)
        draw(record, place, None, _silently)
    return place / "report.html"


@contextmanager
def _os_error() -> Iterator[None]:
    """Raise an OSError about `out` in place of an error about --out."""
    try:
        yield
    except argparse.ArgumentTypeError as error:
        raise OSError(f"out: {error}.") from None
    except SystemExit as error:
        raise OSError(f"out: {str(error).partition(': ')[2].removesuffix(' with --out.')}.") from None


def _own_settings(
    problem: Problem,
    accuracies: Sequence[float],
    rivals: bool | Sequence[str],
    repeats: int,
    methods: Sequence[str] | None,
) -> Settings:
    try:
        errors = [float(error) for error in accuracies]
    except (TypeError, ValueError):
        errors = []
    if not errors or not all(0 < error < 1 for error in errors):
        raise ValueError(
            f"accuracies must be a sequence of numbers between 0 and 1, such as (1e-2, 1e-4), not {shown(accuracies)}."
        )
    if not isinstance(repeats, int) or repeats < 1:
        raise ValueError(f"repeats must be a whole number of at least 1, not {repeats!r}.")
    if not isinstance(rivals, bool):
        rivals = [rivals] if isinstance(rivals, str) else list(rivals)
        unknown = [name for name in rivals if name not in RIVALS]
        if unknown:
            raise ValueError(f"rivals must be True, False or names of {', '.join(RIVALS)}, not {unknown[0]!r}.")
    if methods is not None and not all(isinstance(method, str) for method in methods):
        raise TypeError(f"methods must be names of methods, such as ['eig3', 'rk4'], not {shown(methods)}.")
    names = None if methods is None else [check_method(method).name for method in methods]
    return Settings([problem.name], names, repeats, rivals=rivals, accuracies=errors)
