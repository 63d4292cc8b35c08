"""Import the libraries of the extra "files" when they are used."""

from __future__ import annotations

import importlib
from typing import Any


def library(module: str, ending: str) -> Any:
    """Return a module, or raise an ImportError that names the extra."""
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise ImportError(f"{ending} files need {package}: pip install 'eig3[files]'.") from None
