"""Faults around a run, and what comes of them: `python tests/faults.py` prints a table.

Each trial is a process of its own, because some faults crash it. The trials use only what is public, so that versions
can be compared: run this file with the interpreter of each version. `test_faults.py` runs a part of the trials.
"""

import argparse
import collections
import contextlib
import gc
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HELD = "as it should be"
_PATIENCE = 300  # s, for one trial


@dataclass
class Fault:
    """A fault, the number of its trials, and the function of one trial, which gets the number of the trial."""

    title: str
    trials: int
    trial: Callable[[int], str | None]
    prepare: Callable[[Path, int], None] | None


FAULTS: dict[str, Fault] = {}


def fault(title: str, trials: int, prepare: Callable[[Path, int], None] | None = None):
    """Register the function of a trial. It returns what went wrong, or None if all is as it should be.

    With `prepare`, the trial gets a copy of a warm cache of its own; `prepare` damages it before the trial begins.
    """

    def register(trial):
        FAULTS[trial.__name__] = Fault(title, trials, trial, prepare)
        return trial

    return register


# What is done to a warm cache before a trial ------------------------------------------------------------------------


def kept(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in (".nbi", ".nbc"))


def truncate_one(folder, number):
    files = kept(folder)
    os.truncate(files[number % len(files)], 100)


def empty_one(folder, number):
    files = kept(folder)
    os.truncate(files[number % len(files)], 0)


def flip_a_bit(folder, number):
    chance = random.Random(number)
    path = chance.choice(kept(folder))
    content = bytearray(path.read_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    path.write_bytes(content)


def put_a_folder(folder, number):
    files = kept(folder)
    path = files[number % len(files)]
    path.unlink()
    path.mkdir()


def clear_all(folder, number):
    for path in kept(folder):
        path.unlink()


def leave(folder, number):
    pass


# Ctrl-C --------------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def interrupted(after: float):
    """Send Ctrl-C to this process after some seconds; the block waits for it, and yields a list that shows it came."""
    came: list[str] = []
    sender = threading.Thread(target=lambda: (time.sleep(after), os.kill(os.getpid(), signal.SIGINT)))
    try:
        sender.start()
        yield came
        sender.join()
        time.sleep(0.02)
    except KeyboardInterrupt as error:
        came.append(str(getattr(getattr(error, "solution", None), "status", "no run")))
    sender.join()


def count_lost(trials: int, moments: Callable[[int], float], work: Callable[[], object]) -> str | None:
    lost = 0
    for k in range(trials):
        gc.collect()  # Python ignores an exception in a finalizer, such as those of the modules of earlier trials
        gc.disable()
        with interrupted(moments(k)) as came:
            work()
        gc.enable()
        lost += not came
    return f"{lost} of {trials} swallowed" if lost else None


def new_functions():
    import eig3

    @eig3.jit
    def rhs(t, u, v, p):
        return -u - 0.1 * v

    @eig3.jit
    def chain(t, u, v, p, a):
        for j in range(u.size):
            a[j] = -u[j] - 0.1 * v[j]

    @eig3.jit
    def energy(t, u, v, p):
        return u * u + v * v

    return rhs, chain, energy


@fault("25 times Ctrl-C while functions and kernels compile", 12, clear_all)
def interrupts_while_compiling(number):
    import eig3

    def set_up():
        rhs, chain, energy = new_functions()
        kind = choose(["scalar", "vector", "vector", "inline"])
        if kind == "scalar":
            eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.1, invariants={"e": energy})
        else:
            eig3.Stepper(chain, [1.0], [0.0], h=0.1, inline=kind == "inline")

    choose = random.Random(number).choice
    return count_lost(25, lambda k: random.Random(100 * number + k).uniform(0.001, 0.15), set_up)


@fault("20 times Ctrl-C in a loop of short runs", 2)
def interrupts_in_short_runs(number):
    import eig3

    rhs, _, _ = new_functions()

    def loop():
        end = time.perf_counter() + 0.15
        while time.perf_counter() < end:
            eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=1e-3)

    loop()
    return count_lost(20, lambda k: random.Random(100 * number + k).uniform(0.001, 0.1), loop)


@fault("10 times Ctrl-C in eig3.plan", 4)
def interrupts_in_plan(number):
    import eig3

    problem = eig3.problems.kepler()

    def plan():
        eig3.plan(problem, 1e-4, methods=["eig3", "rk4"])

    plan()
    return count_lost(10, lambda k: random.Random(100 * number + k).uniform(0.001, 0.2), plan)


@fault("10 times Ctrl-C in a run that diverges", 1)
def interrupts_in_diverging_runs(number):
    import eig3

    @eig3.jit
    def bursts(t, u, v, p):
        return -u if t < p[0] else 1e9 * u**3

    def run():
        eig3.integrate(bursts, (0, 400), 1.0, 0.0, h=1e-5, params=390.0, save_every=None)

    run()
    return count_lost(10, lambda k: 0.02 * (k + 1), run)


@fault("Ctrl-C after rhs became 3000 times slower", 2)
def interrupt_of_a_dear_rhs(number):
    import eig3

    @eig3.jit
    def dear(t, u, v, p):
        a = -u
        if t > p[0]:
            for _ in range(3500):
                a = 0.5 * (a - u)
        return a

    begin = 0.0

    def run():
        nonlocal begin
        begin = time.perf_counter()
        with contextlib.suppress(AttributeError):
            eig3.integrate(dear, (0, 1e6), 1.0, 0.0, h=1e-3, params=2000.0 * number, save_every=None)

    eig3.integrate(dear, (0, 100), 1.0, 0.0, h=1e-3, params=1e9)
    with interrupted(0.5):
        run()
    late = time.perf_counter() - begin - 0.5
    return f"answered after {late:.0f} s" if late > 2 else None


# The cache on the disk -----------------------------------------------------------------------------------------------


def use_cache() -> str | None:
    """Run the kernels of both forms, and compare with the exact solution."""
    import eig3

    rhs, chain, _ = new_functions()
    exact = 0.5549917206178984  # exp(-g) (cos w + g/w sin w) for g = 0.05 and w^2 = 1 - g^2
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        solution = eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.001)
        vector = eig3.integrate(chain, (0, 1), [1.0], [0.0], h=0.001)
    if abs(solution.u[-1] - exact) > 1e-6 or abs(vector.u[-1, 0] - exact) > 1e-6:
        return "wrong numbers"
    return None if len(seen) == 1 else f"{len(seen)} warnings"


@fault("a file of the cache is cut to 100 bytes", 10, truncate_one)
def truncated_file(number):
    return use_cache()


@fault("a file of the cache is empty", 10, empty_one)
def empty_file(number):
    return use_cache()


@fault("a bit of a file of the cache is flipped", 60, flip_a_bit)
def flipped_bit(number):
    return use_cache()


@fault("a folder lies in the place of a file of the cache", 10, put_a_folder)
def folder_for_a_file(number):
    return use_cache()


@fault("no file of the cache can be read (a disk error)", 1, leave)
def unreadable_file(number):
    import builtins
    import io

    def failing(file, mode="r", *arguments, **options):
        if str(file).endswith((".nbi", ".nbc")) and "r" in mode:
            raise OSError(5, "Input/output error", str(file))
        return opened(file, mode, *arguments, **options)

    opened, builtins.open, io.open = io.open, failing, failing
    Path.open = lambda path, *arguments, **options: failing(path, *arguments, **options)  # 3.10 keeps its own io.open
    return use_cache()


@fault("no file can be written (as on a full disk)", 1, clear_all)
def full_disk(number):
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    return use_cache()


METHOD = """
from eig3.kernels.compile.jit import element
from coefficients import GAIN

ROWS, EVALUATIONS = 3, 1

@element
def step(f, at, y, c, n):
    u, v, a = y
    f(at.t, u, v, at.p, a)
    for j in range(n):
        u[j], v[j] = u[j] + at.h * v[j], v[j] + GAIN * at.h * a[j]
    return y, True
"""


@fault("the second file of a user's method is edited", 1)
def stale_kernel(number):
    code = """
import eig3, eig3.methods
class Own(eig3.Method):
    name, label, order, kernel = "own", "Own", 1, "own_kernel"
@eig3.jit
def rhs(t, u, v, p):
    return -u
print(eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.5, method=Own()).v[-1])
"""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "own_kernel.py").write_text(METHOD)
        printed = []
        for gain in ("1.0", "2.0"):
            Path(folder, "coefficients.py").write_text(f"GAIN = {gain}\n")
            environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
            command = [sys.executable, "-c", code]
            result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
            printed.append(result.stdout)
    return "the kernel before the edit runs" if printed[0] == printed[1] else None


# Trials --------------------------------------------------------------------------------------------------------------


def outcome(name: str, number: int, cache: Path) -> str:
    """Run one trial in a process of its own, and say what came of it. `cache` is a warm cache."""
    environment = {**os.environ, "PYTHONWARNINGS": "ignore"}
    with tempfile.TemporaryDirectory() as folder:
        prepare = FAULTS[name].prepare
        if prepare:
            copy = shutil.copytree(cache, Path(folder, "cache"))
            prepare(copy, number)
            environment["NUMBA_CACHE_DIR"] = str(copy)
        command = [sys.executable, __file__, "--trial", name, str(number)]
        result = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=_PATIENCE, cwd=folder, check=False
        )
    if result.returncode < 0:
        return f"crash ({signal.Signals(-result.returncode).name})"
    if result.returncode:
        lines = result.stderr.strip().splitlines()
        errors = [line for line in lines if re.match(r"[\w.]+Error: ", line)]
        return re.sub(r": '/.*", "", [lines[-1], *errors][-1])[:90]  # without the name of the file
    return result.stdout.strip().splitlines()[-1]


def warm_cache(folder: Path) -> None:
    """Fill a folder with the kernels that `use_cache` needs."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    subprocess.run([sys.executable, __file__, "--warm"], env=environment, check=True, timeout=_PATIENCE)


def run_trial(name: str, number: int) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts background jobs with the signal ignored
    print(FAULTS[name].trial(number) or HELD)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"the faults (default: all): {', '.join(FAULTS)}")
    parser.add_argument("--trial", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--warm", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.trial:
        run_trial(options.trial[0], int(options.trial[1]))
        return
    if options.warm:
        use_cache()
        return
    print("| fault | trials | outcome |\n| ----- | -----: | ------- |")
    with tempfile.TemporaryDirectory() as folder:
        warm_cache(Path(folder))
        for name in options.names or FAULTS:
            found = collections.Counter(outcome(name, k, Path(folder)) for k in range(FAULTS[name].trials))
            text = "; ".join(f"{count} x {what}" for what, count in found.most_common())
            print(f"| {FAULTS[name].title} | {FAULTS[name].trials} | {text} |", flush=True)


if __name__ == "__main__":
    main()
