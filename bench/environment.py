"""The machine and the versions of a benchmark."""

import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numba
import numpy

from eig3 import __version__

from .rivals import RIVALS

_OTHERS = dict.fromkeys(["jax", *(rival.package for rival in RIVALS.values())])


def environment() -> dict[str, str | int]:
    """Machine and versions by name."""
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numba": numba.__version__,
        "numpy": numpy.__version__,
        "eig3": __version__,
        **{name: version(name) for name in _OTHERS if find_spec(name)},
    }


def in_words(e: Mapping[str, str | int] | None = None) -> str:
    """An environment, by default this one, on one line."""
    e = e or environment()
    versions = ", ".join(f"{name} {e[name]}" for name in ("python", "numba", "numpy", "eig3"))
    return f"{e['cpu']}, {e['cores']} cores, {e['system']}; {versions}"


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
