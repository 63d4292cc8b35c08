"""The parts of a report, in the order in which they are measured: first those that answer its question."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eig3.command_line import Files
from eig3.drawing import before_growth, histories
from eig3.methods import LIBRARY
from eig3.named_problem import is_own
from eig3.problem import Problem

from .. import c, hard, paper, pictures, plan, stability, trust
from ..article import TABLES
from ..article_runs import measure as measure_table
from ..modes import MODES
from ..problem_set import PROBLEM_SET, VARIABLE_SPEED
from ..sweep import measure
from . import own_problem
from .record import Record, motion_file, part_name
from .true_motion import VALUES

if TYPE_CHECKING:
    from PIL import Image

COMMAND = "eig3 bench report"

#: The accuracies of a problem of the library: ten decades.
DECADES = tuple(10.0**-k for k in range(1, 11))
_STATES = 12_001  # of the motion that is drawn
_FEWEST = 3  # states; a run that fails before has no picture
_ACCURATE = 1e-6  # its relative tolerance
_MOST_STEPS = 1_000_000
_SIZE, _DPI = (9.0, 5.0), 100  # of its picture, inches, and pixels in an inch
_QUALITIES = (80, 60, 40, 20)  # of the picture, the first with which the file is small enough,
_NARROWER = 0.8  # and the factor of its width for as long as none of them is
_LARGEST = 40_000  # bytes


@dataclass(frozen=True)
class Settings:
    """What a report measures; None stands for everything there is.

    `repeats` is the number of runs for a median, and `longest` the time (s) at which steps are halved no more.
    """

    problems: list[str] | None = None
    methods: list[str] | None = None
    repeats: int = 5
    longest: float = 0.02
    modes: list[str] | None = None
    rivals: bool | list[str] = True
    accuracies: list[float] | None = None

    @property
    def options(self) -> str:
        """The options of `eig3 bench precision` that these settings ask for."""
        words = [f"--repeats {self.repeats} --longest {self.longest:g}"]
        words += ["--no-rivals"] * (not self.rivals)
        words += [f"--method {name}" for name in self.methods or ()]
        return " ".join([*words, "--accuracies", *(f"{accuracy:g}" for accuracy in self.accuracies or DECADES)])

    @property
    def changed(self) -> dict[str, Any]:
        """The settings that are not the defaults."""
        return {name: value for name, value in vars(self).items() if value != getattr(Settings, name)}


@dataclass(frozen=True)
class Part:
    """A part: its name, the command that measures it alone, and a function that measures it and gives its data."""

    name: str
    command: str
    measure: Callable[[Record], Any]


def command_line(out: str | Path, given: Mapping[str, Any]) -> str:
    """The command of a report that asks for these settings."""
    words = [*COMMAND.split(), "--out", str(out)]
    for name, value in given.items():
        if name == "rivals":
            words.append("--no-rivals")
        elif name == "accuracies":
            words += ["--accuracies", *(f"{accuracy:g}" for accuracy in value)]
        elif isinstance(value, list):
            words += [word for entry in value for word in (f"--{name.removesuffix('s')}", entry)]
        else:
            words += [f"--{name}", f"{value:g}"]
    return shlex.join(words)


def parts_of(settings: Settings) -> list[Part]:
    """The parts in their order. With `problems`, only what is about them."""
    names = list(dict.fromkeys(settings.problems or [*PROBLEM_SET, *VARIABLE_SPEED]))
    found = [_precision(name, settings) for name in names]
    if settings.methods is None:  # the planner chooses from all
        found += [_plan(name, settings) for name in names if name in PROBLEM_SET]
    if settings.problems is None:
        found += [_article(table.number, settings) for table in paper.TABLES]
        found += _c(settings)
        found += [_printed("stability", stability), _printed("hard", hard)]
        found.append(_printed("trust", trust, repeats=settings.repeats))
    return found


def _precision(name: str, settings: Settings) -> Part:
    if is_own(name):
        command = command_line("DIR", {**settings.changed, "problems": [name]})
        return Part(part_name("precision", name), command, lambda record: _own(name, settings, record))
    command = f"eig3 bench precision --problem {name} {settings.options}"
    return Part(part_name("precision", name), command, partial(_of_the_set, name, settings))


def _of_the_set(name: str, settings: Settings, record: Record) -> dict[str, Any]:
    chosen = replace((PROBLEM_SET | VARIABLE_SPEED)[name], targets=tuple(settings.accuracies or DECADES))
    draw_motion(record, name, chosen.build())
    methods, modes = settings.methods or LIBRARY, settings.modes or list(MODES)
    limits = settings.repeats, settings.longest
    return measure(name, chosen, methods, *limits, rivals=bool(settings.rivals), modes=modes).as_json()


def _own(name: str, settings: Settings, record: Record) -> dict[str, Any]:
    problem, about = own_problem.load(name)
    try:
        return measure_own(record, name, problem, about, settings)
    except Exception as error:  # of the user's functions too
        raise SystemExit(f"{COMMAND}: --problem {name}: {type(error).__name__}: {error}") from None


def measure_own(record: Record, name: str, problem: Problem, about: str, settings: Settings) -> dict[str, Any]:
    """Draw the motion of a user's problem, and measure it."""
    draw_motion(record, name, problem)
    accuracies, modes = settings.accuracies or own_problem.ACCURACIES, settings.modes or list(MODES)
    options: dict[str, Any] = {"repeats": settings.repeats, "rivals": settings.rivals, "methods": settings.methods}
    return own_problem.measure(problem, accuracies, name=name, about=about, modes=modes, **options).as_json()


def draw_motion(record: Record, name: str, problem: Problem) -> None:
    """Draw the motion of a problem into a small file of the record."""
    times = np.linspace(*problem.t_span, min(_STATES, max(_FEWEST, VALUES // np.size(problem.u0))))
    solution = problem.integrate(rtol=_ACCURATE, t_eval=times, invariants={}, max_steps=_MOST_STEPS)
    if len(solution.t) < _FEWEST:
        return
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure = pictures.new_figure(*_SIZE)
    (problem.draw or histories)(figure, before_growth(solution))
    figure.dpi = _DPI
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    with Files(record.folder, COMMAND).writing(motion_file(name)) as path:
        for smaller, quality in _ever_smaller(picture):
            smaller.save(path, quality=quality, method=6)
            if path.stat().st_size <= _LARGEST:
                break


def _ever_smaller(picture: Image.Image) -> Iterator[tuple[Image.Image, int]]:
    """A picture with each quality; then ever narrower ones with the last quality."""
    for quality in _QUALITIES:
        yield picture, quality
    while True:
        picture = picture.resize((round(_NARROWER * picture.width), round(_NARROWER * picture.height)))
        yield picture, quality


def _plan(name: str, settings: Settings) -> Part:
    def measured(record: Record) -> list[dict[str, Any]]:
        swept = next((result for result in record.results if result.name == name and "pointer" in result.modes), None)
        outcomes = plan.outcomes_of(name, settings.repeats, settings.longest, swept and swept.in_mode("pointer"))
        return [asdict(outcome) for outcome in outcomes]

    options = f"--repeats {settings.repeats} --longest {settings.longest:g}"
    return Part(part_name("plan", name), f"eig3 bench plan {options} --problem {name}", measured)


def _article(number: int, settings: Settings) -> Part:
    (table,) = (table for table in TABLES if table.number == number)
    command = f"eig3 bench paper --table {number} --quick --repeats {settings.repeats}"

    def measured(record: Record) -> dict[str, Any]:
        return measure_table(table, paper.steps_of(table, quick=True), settings.repeats).as_json()

    return Part(part_name("article", str(number)), command, measured)


def _c(settings: Settings) -> list[Part]:
    """The comparison with C, if one of the methods is there in C."""
    methods = [name for name in settings.methods or LIBRARY if name in c.METHODS_IN_C]
    command = f"eig3 bench c --repeats {settings.repeats}"
    if settings.methods:
        command += "".join(f" --method {name}" for name in methods)

    def measured(record: Record) -> dict[str, Any]:
        lines: list[str] = []
        timings = c.benchmark(methods=methods, repeats=settings.repeats, write=lines.append)
        return {"markdown": _page(lines), "timings": timings}

    return [Part("c", command, measured)] if methods else []


def _printed(name: str, module: Any, **options: int) -> Part:
    """What a benchmark prints. Its headings, and the titles of its cases, are one level lower on the page."""

    def measured(record: Record) -> dict[str, Any]:
        lines: list[str] = []
        module.benchmark(**options, write=lines.append)
        return {"markdown": re.sub(r"(?m)^(\d+\. )", r"### \1", _page(lines)).replace("\n## ", "\n### ")}

    command = ["eig3 bench", name, *(f"--{option} {value}" for option, value in options.items())]
    return Part(name, " ".join(command), measured)


def _page(lines: list[str]) -> str:
    """What a benchmark prints, as paragraphs, without the machine, which the report names once."""
    return "\n\n".join(line.strip("\n") for line in lines if line.strip() and not line.startswith("Machine: "))
