"""Measure the time per step (ns) of the kernels in both modes, and of the article's algorithms in C99.

The system's compiler (cc, or the environment variable CC) builds the C code during the benchmark.
Its loops run in the same process.
"""

import argparse
import ctypes
import os
import shlex
import shutil
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eig3.command_line import add_methods
from eig3.methods import METHODS
from eig3.problem import Problem

from . import loops, text
from .choices import add_repeats, choose
from .environment import in_words
from .timing import Storage, interleave

SUMMARY = "ns/step of every method, compared with the article's algorithms in C"
SOURCE = Path(__file__).parent / "c_sources" / "baseline.c"
METHODS_IN_C = ("eig3", "cd", "rk2", "rk3", "ab2", "ab3")
FLAGS = {"-O3": ["-O3"], "-O3 native": ["-O3", "-march=native"]}
_IN_C = {f"C {flags}{how}": (flags, bool(how)) for how in ("", " inlined") for flags in FLAGS}
HEADER = [
    "problem, method",
    "C -O3",
    "C native",
    "C -O3, inlined",
    "C native, inlined",
    "pointer",
    "inline",
    "pointer / C",
    "inline / C",
    "inline / floor",
]

_double, _array = ctypes.c_double, np.ctypeslib.ndpointer(np.float64, flags="C")


def add_options(parser: argparse.ArgumentParser) -> None:
    add_methods(parser)
    add_repeats(parser, 9)


@dataclass(frozen=True)
class Library:
    """The C code built with one set of flags."""

    handle: Any

    def loop(self, problem: Problem, h: float, method: str, storage: Storage, *, inline: bool) -> Callable[[], float]:
        """A run whose right-hand side is inlined or called through a pointer; it returns its seconds."""
        form = "vector" if loops.is_vector(problem) else "scalar"
        function = getattr(self.handle, f"{method}_{problem.name if inline else form}")
        state = _array if form == "vector" else _double
        types = [state, state, _array, _double, ctypes.c_long, _array, _array]
        function.argtypes = types if inline else [ctypes.c_void_p, *types]
        function.restype = None
        pointer = getattr(self.handle, f"pointer_{problem.name}")
        pointer.restype = ctypes.c_void_p
        callback = () if inline else (pointer(),)
        params = np.array(problem.params, dtype=np.float64)
        return loops.timed_call(
            problem, lambda u, v: function(*callback, u, v, params, h, loops.N_STEPS, storage.u, storage.v)
        )


def build(flags: Sequence[str], folder: Path) -> Library:
    """Compile the C code with the system's compiler into `folder`."""
    target = folder / f"baseline{len(list(folder.iterdir()))}.so"
    compile_with("-std=c99", *flags, "-shared", "-fPIC", str(SOURCE), "-o", str(target), "-lm")
    return Library(ctypes.CDLL(str(target)))


def build_all() -> dict[str, Library]:
    """The C code built with each set of flags; nothing if there is no compiler.

    Raises
    ------
    SystemExit
        If the compiler fails, or the temporary folder cannot hold the compiled code or does not let it run.
    """
    if not has_compiler():
        return {}
    try:
        with tempfile.TemporaryDirectory() as folder:  # code that is loaded no longer needs its file
            return {name: build(flags, Path(folder)) for name, flags in FLAGS.items()}
    except OSError as error:
        raise SystemExit(
            f"eig3 bench c: the temporary folder cannot hold and run the C code ({error}). "
            "Name another folder with TMPDIR=..."
        ) from None


def compiler() -> list[str]:
    """The command that calls the C compiler."""
    return os.environ.get("CC", "").split() or ["cc"]


def has_compiler() -> bool:
    return shutil.which(compiler()[0]) is not None


def compile_with(*arguments: str) -> str:
    """Call the compiler; return what it prints.

    Raises
    ------
    SystemExit
        If the compiler fails. The message ends with the compiler's command and its own message.
    """
    command = [*compiler(), *arguments]
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True, errors="replace").stdout
    except (OSError, subprocess.CalledProcessError) as error:
        message = getattr(error, "stderr", str(error)).strip() or "It printed no message."
        raise SystemExit(
            "eig3 bench c: the C compiler failed. Name another compiler with CC=... or, if its message is about space, "
            f"another temporary folder with TMPDIR=...\n{shlex.join(command)}\n{message}"
        ) from None


def version() -> str:
    """The first line of the compiler's version, or that there is no compiler."""
    if not has_compiler():
        return f"no compiler ({compiler()[0]}) here, so its columns are empty; install one, or name one with CC=..."
    return compile_with("--version").partition("\n")[0]


#: The seconds of the runs of each column, by row.
Timings = dict[str, dict[str, list[float]]]


def benchmark(
    *, methods: Sequence[str] | None = None, repeats: int = 9, write: Callable[[str], None] = print
) -> Timings:
    """Print ns/step of C and of both modes, with ratios. Without a compiler the columns of C hold dashes."""
    chosen = choose(methods, METHODS_IN_C)
    libraries = build_all()
    write(f"Machine: {in_words()}")
    write(f"C: {version()}")
    write(f"ns/step, every state stored: medians of {repeats} interleaved runs of {loops.N_STEPS} steps.")
    write("C has the article's order of operations. / C is the ratio to C -O3, with the rhs through a pointer.\n")
    timings = {
        f"{problem.name}, {METHODS[name]().label}": compare(problem, h, name, libraries, repeats)
        for problem, h in ((make(), h) for make, h in loops.ARTICLE_PROBLEMS)
        for name in chosen
    }
    write(text.table(HEADER, [[label, *cells(seconds)] for label, seconds in timings.items()]))
    return timings


def compare(
    problem: Problem, h: float, method: str, libraries: dict[str, Library], repeats: int
) -> dict[str, list[float]]:
    """The seconds of each column for one method on one problem, and of the floor, a lower bound."""
    storage = Storage.for_steps(problem, loops.N_STEPS)
    runs = {
        column: libraries[flags].loop(problem, h, method, storage, inline=inline)
        for column, (flags, inline) in _IN_C.items()
        if flags in libraries
    }
    runs["pointer"] = loops.kernel_loop(problem, h, method, storage, inline=False)
    runs["inline"] = loops.kernel_loop(problem, h, method, storage, inline=True)
    runs["floor"] = loops.floor_loop(problem, h, storage)
    return interleave(runs, repeats, f"{problem.name}, {method}")


def cells(seconds: Mapping[str, Sequence[float]]) -> list[str]:
    """A row of the table, from the seconds of its runs."""
    ns = {name: 1e9 * statistics.median(values) / loops.N_STEPS for name, values in seconds.items()}
    times = [f"{ns[name]:.1f}" if name in ns else "-" for name in (*_IN_C, "pointer", "inline")]
    pairs = (("pointer", "C -O3"), ("inline", "C -O3"), ("inline", "floor"))
    ratios = [f"{ns[a] / ns[b]:.2f}" if b in ns else "-" for a, b in pairs]
    return [*times, *ratios]
