"""`eig3 bench c`: the kernels beside the article's algorithms in C, called in the same process, interleaved."""

import ctypes
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eig3.methods import METHODS
from eig3.problem import Problem

from . import handwritten, speed, text
from .environment import in_words
from .timing import Storage, interleave

SOURCE = Path(__file__).parent / "c" / "baseline.c"
METHOD_NAMES = ("eig3", "cd", "rk2", "rk3", "ab2", "ab3")
STEPS = {make().name: h for make, h in speed.CASES}
FLAGS = {"-O3": ["-O3"], "-O3 native": ["-O3", "-march=native"]}
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


@dataclass(frozen=True)
class Library:
    """The baseline built with one set of flags."""

    handle: Any

    def loop(self, problem: Problem, method: str, storage: Storage, *, inline: bool) -> Callable[[], float]:
        """A run of `method` on `problem`, with its right-hand side inlined or through a pointer; gives its seconds."""
        vector = np.ndim(problem.u0) == 1
        name = problem.name if inline else ("vector" if vector else "scalar")
        function = getattr(self.handle, f"{method}_{name}")
        state = _array if vector else _double
        function.argtypes = [
            *([] if inline else [ctypes.c_void_p]), state, state, _array, _double, ctypes.c_long, _array, _array,
        ]  # fmt: skip
        function.restype = None
        pointer = getattr(self.handle, f"pointer_{problem.name}")
        pointer.restype = ctypes.c_void_p
        callback = () if inline else (pointer(),)
        params = np.array(problem.params, dtype=np.float64)

        def run() -> float:
            u, v = speed.initial_state(problem)
            begin = time.perf_counter()
            function(*callback, u, v, params, STEPS[problem.name], speed.N_STEPS, storage.u, storage.v)
            return time.perf_counter() - begin

        return run


def build(flags: Sequence[str], folder: Path) -> Library:
    """Compile the baseline with the system's compiler into `folder`."""
    target = folder / f"baseline{len(list(folder.iterdir()))}.so"
    command = ["cc", "-std=c99", *flags, "-shared", "-fPIC", str(SOURCE), "-o", str(target), "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return Library(ctypes.CDLL(str(target)))


def compiler() -> str | None:
    """The first line of the system compiler's version; None where there is none."""
    if shutil.which("cc") is None:
        return None
    lines = subprocess.run(["cc", "--version"], check=True, capture_output=True, text=True).stdout.splitlines()
    return lines[0]


def run(*, methods: Sequence[str] | None = None, repeats: int = 9, write: Callable[[str], None] = print) -> None:
    """Print ns/step of C and of both modes, with ratios; without a compiler the columns of C are dashes."""
    chosen = speed.choose(methods, METHOD_NAMES)
    version = compiler()
    write(f"Machine: {in_words()}")
    write(f"C: {version or 'no compiler (cc) here, so its columns are empty'}")
    write(f"ns/step, every state stored: medians of {repeats} interleaved runs of {speed.N_STEPS} steps.")
    write("C in the article's order of operations; / C is over C -O3 with the right-hand side through a pointer.\n")
    with tempfile.TemporaryDirectory() as folder:
        libraries = {name: build(flags, Path(folder)) for name, flags in FLAGS.items()} if version else {}
        rows = [compare(make(), h, name, libraries, repeats) for make, h in speed.CASES for name in chosen]
    text.status("")
    write(text.table(HEADER, rows))


def compare(problem: Problem, h: float, method: str, libraries: dict[str, Library], repeats: int) -> list[str]:
    """The row of one method on one problem."""
    vector = np.ndim(problem.u0) == 1
    storage = Storage(np.size(problem.u0) if vector else None, speed.N_STEPS)
    floor = handwritten.floor_pair if vector else handwritten.floor_scalar
    runs = {f"C {flags}": library.loop(problem, method, storage, inline=False) for flags, library in libraries.items()}
    runs |= {
        f"C {flags} inlined": library.loop(problem, method, storage, inline=True)
        for flags, library in libraries.items()
    }
    runs["pointer"] = speed.ours(problem, h, method, storage, inline=False)
    runs["inline"] = speed.ours(problem, h, method, storage, inline=True)
    runs["floor"] = speed.theirs(problem, h, floor, storage, inline=True)
    seconds = interleave(runs, repeats, lambda what: text.status(f"{problem.name}, {method}, {what}"))
    ns = {name: 1e9 * statistics.median(values) / speed.N_STEPS for name, values in seconds.items()}
    columns = [*(f"C {flags}{how}" for how in ("", " inlined") for flags in FLAGS), "pointer", "inline"]
    pairs = (("pointer", "C -O3"), ("inline", "C -O3"), ("inline", "floor"))
    ratios = [f"{ns[a] / ns[b]:.2f}" if b in ns else "-" for a, b in pairs]
    times = [f"{ns[name]:.1f}" if name in ns else "-" for name in columns]
    return [f"{problem.name}, {METHODS[method].label}", *times, *ratios]
