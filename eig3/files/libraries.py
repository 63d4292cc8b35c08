"""Import the libraries of extras when they are used."""

from __future__ import annotations

import importlib
from typing import Any


def library(module: str, ending: str, extra: str = "files") -> Any:
    """Return a module, or raise an ImportError that names the extra."""
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise ImportError(f"{ending} files need {package}: pip install 'eig3[{extra}]'.") from None
