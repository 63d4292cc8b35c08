"""Effects that use the law of a link: they have its parameters, and functions that call the functions of the law."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any

from ..functions.callbacks import jit
from ..kernels.compile.source import Writer, define
from .effect import Effect, Link, arguments


class OfLaw(Effect):
    """The base class of effects of a law, which is their field `law`.

    A parameter of the law is an attribute of the effect too, so that compiled functions can take it.
    """

    law: Any

    def __getattr__(self, name: str) -> Any:
        if name == "law" or name.startswith("_"):  # a copy has no law yet
            raise AttributeError(f"{type(self).__name__} has no attribute {name}.")
        return getattr(self.law, name)

    def check_law(self) -> None:
        """Refuse what is not a law of links along one line."""
        if not isinstance(self.law, Link):
            raise TypeError(f"law of {type(self).__name__} must be a link of eig3.effects, not {self.law!r}.")
        if self.law.directions > 1:
            raise ValueError(f"law of {type(self).__name__} must act along one line, and {self.law.title} does not.")

    def parameters(self) -> list[str]:
        return [*self.law.parameters(), *(name for name in super().parameters() if name != "law")]

    @property
    def vectors(self) -> tuple[str, ...]:  # type: ignore[override]  # of the law
        return tuple(self.law.vectors)

    @property
    def arrays(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(self.law.arrays)

    @property
    def state_size(self) -> int:  # type: ignore[override]
        return int(self.law.state_size)

    def components(self, vector: str, dimension: int) -> int:
        return int(self.law.components(vector, dimension))


def has_state(functions: dict[str, Any]) -> bool:
    """Return whether a law with these functions has a state."""
    return any("state" in arguments(function) for function in functions.values())


def call_of(name: str, function: Any, state: str = "state") -> str:
    """Return the source of a call of a function of a law, with the source of its state."""
    return f"law_{name}({', '.join(state if x == 'state' else x for x in arguments(function))})"


def calling(
    law: dict[str, Any], lines: dict[str, list[str]], known: Collection[str], what: str, names: dict[str, Any]
) -> tuple[tuple[str, Any], ...]:
    """Return the compiled functions with these lines, which call a law; their arguments are the known names."""
    out = Writer()
    for name, text in lines.items():
        words = dict.fromkeys(re.findall(r"\w+", " ".join(text)))
        with out.block(f"def {name}({', '.join(word for word in words if word in known)})"):
            out.line(*text)
    defined = define(str(out), what, names | {f"law_{name}": function for name, function in law.items()})
    return tuple((name, jit(defined[name])) for name in lines)
