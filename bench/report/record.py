"""The numbers of a report: a folder of JSON files, one for each part, which a run that was cut off keeps."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from eig3.command_line import Files, file_name

from .. import plan
from ..article_runs import MeasuredTable
from ..environment import environment, in_words
from ..modes import MODES
from ..sweep import WorkPrecisionSet
from ..typed import check_known, check_positive, checked, fits

RUN = "run.json"
_FORMAT = 1
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f]")


class RecordError(ValueError):
    """A folder without a record, or a file of a record that cannot be read."""


@dataclass(frozen=True)
class Text:
    """What a benchmark says, as paragraphs and tables in Markdown, and the command that measures it."""

    command: str
    markdown: str


@dataclass(frozen=True)
class Measured:
    """A part that was measured: the command that measures it alone, how long it took (s), and its data."""

    command: str
    seconds: float
    data: Any


@dataclass(frozen=True)
class Run:
    """What a run was asked for, where it ran, and the names of its parts in their order."""

    command: str
    environment: dict[str, str | int]
    settings: dict[str, Any]
    parts: list[str]


class Record:
    """A run of the report in a folder: what it was asked for, and the parts that are measured.

    Attributes
    ----------
    folder : Path
    run : Run
    measured : dict of str to Measured
        The parts by name, such as "precision_kepler_03", "article_1", "plan_duffing", "c", "stability" and "hard".
    """

    def __init__(self, folder: Path, run: Run, measured: dict[str, Measured]) -> None:
        self.folder, self.run, self.measured = folder, run, measured
        self._files = Files(folder, "eig3 bench report")

    @classmethod
    def create(cls, folder: Path, command: str, settings: Mapping[str, Any], parts: Sequence[str]) -> Record:
        """A record without any part; parts of an older record in the folder, and their pictures, are removed."""
        record = cls(folder, Run(command, environment(), dict(settings), list(parts)), {})
        for name in parts:
            record._path(name).unlink(missing_ok=True)
            (folder / _motion_of(name)).unlink(missing_ok=True)
        record._write(RUN, {"format": _FORMAT, **vars(record.run)})
        return record

    @classmethod
    def open(cls, folder: Path) -> Record:
        """The record in a folder.

        Raises
        ------
        RecordError
            If there is none, or if one of its files cannot be read.
        """
        path = folder / RUN
        if not path.exists():
            raise RecordError(f"{folder} has no {RUN}, so it holds no report: measure one with --out {folder}.")
        run = _read(path, _run)
        record = cls(folder, run, {})
        for name in run.parts:
            if record._path(name).exists():
                record.measured[name] = _read(record._path(name), partial(_decoded, name))
        return record

    def keep(self, name: str, command: str, seconds: float, data: Any) -> None:
        """Write a part to its file, and read it back."""
        content = {"command": command, "seconds": seconds, "data": data}
        self._write(f"{name}.json", content)
        self.measured[name] = _decoded(name, content)

    @property
    def missing(self) -> list[str]:
        """The names of the parts that are not measured yet."""
        return [name for name in self.run.parts if name not in self.measured]

    @property
    def results(self) -> list[WorkPrecisionSet]:
        """Work and precision of each problem that a chosen method or a rival can solve."""
        return [replace(part.data, command=part.command) for part in self._parts("precision") if part.data.is_solved]

    @property
    def unsolved(self) -> list[str]:
        """The titles of the problems that no chosen method and no rival can solve."""
        return [part.data.title for part in self._parts("precision") if not part.data.is_solved]

    @property
    def article(self) -> list[MeasuredTable]:
        """The article's tables."""
        return [part.data for part in self._parts("article")]

    @property
    def article_commands(self) -> list[str]:
        """The commands that measure the article's tables, one for each."""
        return [part.command for part in self._parts("article")]

    @property
    def timings(self) -> dict[str, dict[str, list[float]]]:
        """The seconds of the runs beside C, by row and column."""
        return self.measured["c"].data["timings"] if "c" in self.measured else {}

    @property
    def texts(self) -> dict[str, Text]:
        """What the parts say that have no pictures."""
        found = {}
        planned = self._parts("plan")
        if planned:
            outcomes = [outcome for part in planned for outcome in part.data]
            how = plan.how_measured(self.run.settings["repeats"])
            found["plan"] = Text(_together([p.command for p in planned]), f"{how}\n\n{plan.render(outcomes)}")
        for name in ("c", "stability", "hard", "trust"):
            if name in self.measured:
                part = self.measured[name]
                found[name] = Text(part.command, part.data["markdown"])
        return found

    def motion(self, name: str) -> Path | None:
        """The picture of the motion of a problem, if there is one.

        Raises
        ------
        RecordError
            If the file is not a WebP picture: a page would carry a foreign file, or a link to one, to other people.
        """
        path = self.folder / motion_file(name)
        if not path.exists():
            return None
        try:
            with path.open("rb") as file:
                head = file.read(12)
        except OSError as error:
            raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None
        if (head[:4], head[8:]) != (b"RIFF", b"WEBP"):
            raise RecordError(f"{path} is not a WebP picture: remove it.")
        return path

    def _parts(self, kind: str) -> list[Measured]:
        return [self.measured[name] for name in self.run.parts if name.startswith(f"{kind}_") and name in self.measured]

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def _write(self, name: str, content: Mapping[str, Any]) -> None:
        with self._files.writing(name) as path:
            path.write_text(json.dumps(content, separators=(",", ":"), allow_nan=False) + "\n", encoding="utf-8")
        self._files.check()


def motion_file(name: str) -> str:
    """The name of the file with the motion of a problem."""
    return _motion_of(part_name("precision", name))


def _motion_of(part: str) -> str:
    return f"motion_{part.removeprefix('precision_')}.webp"


def part_name(kind: str, name: str) -> str:
    """The name of a part about a problem or a table."""
    return file_name(f"{kind}_{name}")


def _read(path: Path, convert: Callable[[Any], Any]) -> Any:
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number)
        json.dumps(content, ensure_ascii=False).encode()  # raises an error for half of a surrogate pair
        return convert(content)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError):
        raise RecordError(f"{path} is damaged or no file of a report: remove it and measure it again.") from None


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not a number of JSON")


def _run(content: Any) -> Run:
    """What a run was asked for. A run of another version may lack settings that no page needs."""
    if content["format"] != _FORMAT:
        raise ValueError
    run = checked(Run(*(content[name] for name in ("command", "environment", "settings", "parts"))))
    if _CONTROL.search(in_words(run.environment) + "".join(map(str, run.environment.values()))):
        raise ValueError  # the commands print it on the terminal
    repeats, longest, modes = (run.settings[name] for name in ("repeats", "longest", "modes"))
    if not (fits(repeats, int) and fits(longest, float) and fits(modes, list[str] | None)):
        raise TypeError
    check_positive([repeats, longest])
    check_known(modes or (), MODES)
    if not all(name == file_name(name) for name in run.parts):  # a foreign file does not name files elsewhere
        raise ValueError
    return run


def _decoded(name: str, content: Any) -> Measured:
    kind, data = name.partition("_")[0], content["data"]
    if kind == "precision":
        data = WorkPrecisionSet.from_json(data)
        if part_name(kind, data.name) != name:
            raise ValueError
    elif kind == "article":
        data = MeasuredTable.from_json(data)
    elif kind == "plan":
        data = [plan.Outcome(**outcome) for outcome in data]
    else:
        data = {"timings": {}, **data}
        if not (fits(data["markdown"], str) and fits(data["timings"], dict[str, dict[str, list[float]]])):
            raise TypeError
        for seconds in (seconds for columns in data["timings"].values() for seconds in columns.values()):
            check_positive([statistics.median(seconds), *seconds])
    return checked(Measured(content["command"], content["seconds"], data))


def _together(commands: Sequence[str]) -> str:
    """One command for several that differ in their last words, `--problem NAME`."""
    first = commands[0].rpartition(" --problem ")[0]
    return first + "".join(command.removeprefix(first) for command in commands)
