"""Command-line options that commands and benchmarks share, and the files that they write with `--out`."""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

MOST_DIGITS = 15  # of a count; a larger number of members, steps or files does not fit in memory
#: A command prints this after the names of the files that it wrote, if it cannot draw.
NO_PICTURES = "; no pictures, since matplotlib is not installed (pip install 'eig3[plot]')"
_OF_FILES = {".csv", ".gif", ".html", ".json", ".md", ".mp4", ".npz", ".png", ".svg", ".txt"}
_LONGEST = 100  # bytes of a file name without its suffix; most systems allow 255 with it
_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)\s*(\.|$)", re.IGNORECASE)  # Windows takes these for devices


def count(text: str) -> int:
    """Convert the text of an option to a whole number of at least 1."""
    if not text.isdecimal() or len(text) > MOST_DIGITS or int(text) < 1:
        words = f"must be a whole number of at least 1, of {MOST_DIGITS} digits at most, not {text[:40]!r}"
        raise argparse.ArgumentTypeError(words)
    return int(text)


def folder(text: str) -> Path:
    """Convert the text of an option to a folder, which `Files` creates. Test writing: errors come before the command.

    Raises
    ------
    argparse.ArgumentTypeError
        If it looks like a file, it cannot be created, or a file of one block cannot be written there.
    """
    path = Path(text)
    if path.suffix.lower() in _OF_FILES and not path.is_dir():
        raise argparse.ArgumentTypeError(f"must be a folder, and not the file {text!r}: leave its ending out")
    new: list[Path] = []
    try:
        with _usage_error(f"cannot create the folder {text!r}"):
            new += (each for each in (path, *path.parents) if not each.exists())
            path.mkdir(parents=True, exist_ok=True)
        with _usage_error(f"cannot write to the folder {text!r}"), _unfinished(path) as place:
            (place / "block").write_bytes(bytes(4096))
    finally:
        for each in new:
            with suppress(OSError):
                each.rmdir()
    return path


def file(text: str) -> str:
    """Return the text of an option, the path of a file. If its folder exists, test writing there, as `folder` does."""
    parent = Path(text).parent
    if parent.is_dir():
        folder(str(parent))
    return text


@contextmanager
def _usage_error(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{what}: {_reason(error)}; choose another folder") from None


@contextmanager
def _unfinished(path: Path) -> Iterator[Path]:
    """Yield a new temporary folder in the folder `path`; remove it with its content."""
    with tempfile.TemporaryDirectory(dir=path, prefix="unfinished-") as place:
        yield Path(place)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


def add_out(parser: argparse.ArgumentParser, text: str, *, type: Callable[[str], Path] = folder) -> None:
    """Add the option `--out DIR`, the folder for results; `text` is its help, and `type` converts its text."""
    parser.add_argument("--out", type=type, metavar="DIR", help=text)


@contextmanager
def printing() -> Iterator[Callable[[str], None]]:
    """Yield a function that prints. Its first error, as on a full disk, comes at the end, after files are written."""
    errors: list[OSError] = []

    def write(text: str) -> None:
        try:
            print(text)
        except OSError as error:
            errors.append(error)

    yield write
    if errors:
        raise errors[0]


class Files:
    """The files that a command writes into the folder of `--out`. After an error, it still writes the others.

    Parameters
    ----------
    folder : Path
        It is created with the first file.
    command : str
        The command, for its error message.
    """

    def __init__(self, folder: Path, command: str) -> None:
        self.folder, self.command = folder, command
        self._reasons: dict[str, str] = {}  # the reason why each file could not be written; empty if it was written

    @contextmanager
    def writing(self, name: str) -> Iterator[Path]:
        """Yield the path for writing the file `name`, and keep the reason of an error of the system.

        An existing file is replaced when the new file is complete.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with _unfinished(self.folder) as place:
                yield place / name
                for file in place.iterdir():
                    file.replace(self.folder / file.name)
        except OSError as error:
            self._reasons[name] = _reason(error)
        else:
            self._reasons[name] = ""

    def leave_out(self, name: str) -> None:
        """Remove the file `name` of an earlier run, which does not belong to the files of this run."""
        (self.folder / name).unlink(missing_ok=True)

    def draw(self, name: str, picture: Callable[[Any], None]) -> str:
        """Write the picture that ``picture(figure)`` draws; return what to add to the list of written files."""
        try:
            from matplotlib.figure import Figure
        except ImportError:
            self.leave_out(name)
            return NO_PICTURES
        figure = Figure(layout="constrained")
        picture(figure)
        with self.writing(name) as path:
            figure.savefig(path, dpi=130)
        return ""

    def finish(self, write: Callable[[str], None], note: str = "") -> None:
        """Write the names of the written files, and `note`; then `check`."""
        written = ", ".join(name for name, reason in self._reasons.items() if not reason)
        write(f"\nWritten to {self.folder}: {written or 'nothing'}{note}")
        self.check()

    def check(self) -> None:
        """Raise SystemExit if the last attempt to write one of the files has failed."""
        failed = ", ".join(f"{name} ({reason})" for name, reason in self._reasons.items() if reason)
        if failed:
            raise SystemExit(
                f"{self.command}: cannot write to the folder {self.folder}: {failed}. Choose another folder with --out."
            )


def file_name(name: str) -> str:
    """Convert any name to a readable file name without a suffix, inside the folder."""
    plain = re.sub(r"[^\w.+ -]", "_", name).strip(". ")
    plain = plain.encode()[:_LONGEST].decode(errors="ignore") or "problem"
    return f"_{plain}" if _DEVICE.match(plain) else plain


def add_methods(parser: argparse.ArgumentParser) -> None:
    """Add the option `--method NAME`. It may be repeated; `options.methods` is then the list of names, or None."""
    parser.add_argument(
        "--method",
        dest="methods",
        action="append",
        type=method_name,
        metavar="NAME",
        help="only this method; may be repeated",
    )


def method_name(text: str) -> str:
    """Convert the label of a method, such as EIG-3, to its name; return other texts, which the command refuses."""
    from .methods import METHODS, named

    found = named(text)
    if not found or found[1]:
        return text
    return next((name for name, record in METHODS.items() if record is found[0]), text)
