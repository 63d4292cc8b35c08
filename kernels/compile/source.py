"""Functions that are written as source: formulas with a variable number of terms, and scenes.

The compiler then sees straight code with only what is needed, and `inspect.getsource` and tracebacks show it.
"""

from __future__ import annotations

import linecache
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

_WRITTEN = re.compile(r"<[a-z]+ [0-9a-f]{8}>")  # the name of a file that `define` gives


def define(text: str, what: str, names: Mapping[str, Any]) -> dict[str, Any]:
    """Execute the source of some functions, which use the globals `names`, and return their namespace.

    `what` is the beginning of the name under which tracebacks show the source.
    """
    filename = f"<{what} {zlib.crc32(text.encode()):08x}>"
    linecache.cache[filename] = len(text), None, text.splitlines(keepends=True), filename
    namespace = dict(names)
    exec(compile(text, filename, "exec"), namespace)
    return namespace


class Writer:
    """Writes Python source; `lines` have what was written so far."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._indent = ""

    def __str__(self) -> str:
        return "\n".join([*self.lines, ""])

    def line(self, *lines: str) -> None:
        """Write lines."""
        self.lines += [self._indent + line for line in lines]

    def insert(self, text: str) -> None:
        """Write the lines of a text."""
        self.line(*text.splitlines())

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Write a head, such as the head of a loop, and what follows below it."""
        self.line(f"{head}:")
        before, self._indent = self._indent, self._indent + "    "
        yield
        self._indent = before

    @contextmanager
    def only_if(self, condition: str) -> Iterator[None]:
        """Write what follows so that it is done on a condition, or always if this is empty."""
        with self.block(f"if {condition}") if condition else nullcontext():
            yield

    def loop(self, rows: Mapping[str, str], many: bool = True) -> None:
        """Write a loop over n, which writes an entry of each of the `rows` from a text with other entries.

        Each entry is read once, before the first is written: this compiles in less time than a text with many indices.
        Without `many`, n is 1, and the lines of the only pass are written without a loop, which would take time to
        compile.
        """
        entry, to = re.compile(r"(\w+)\[j\]"), "j" if many else "0"
        with self.block("for j in range(n)") if many else nullcontext():
            self.line(*(f"{name}_j = {name}[{to}]" for name in dict.fromkeys(entry.findall(" ".join(rows.values())))))
            self.line(*(f"{name}[{to}] = " + entry.sub(r"\1_j", text) for name, text in rows.items()))


def is_beside(code: Any, function: Any) -> bool:
    """Return whether a function is defined in the same written source as some code."""
    own = getattr(function, "__code__", None)
    return own is not None and own.co_filename == code.co_filename and bool(_WRITTEN.fullmatch(own.co_filename))


class Constants:
    """The constants of a step: numbers times a power of h, which are computed once for each call of the kernel."""

    def __init__(self) -> None:
        self._values: list[str] = []

    def __call__(self, number: float, power: int) -> str:
        """Return the text of a constant in a step."""
        value = " * ".join([repr(float(number)), *["h"] * power])
        if value not in self._values:
            self._values.append(value)
        return f"c[{self._values.index(value)}]"

    def write(self, out: Writer) -> None:
        """Write the function `constants` of a method's file."""
        with out.block("def constants(settings, h, work)"):
            out.line(f"return ({''.join(f'{value}, ' for value in self._values)})")


def after_sum(base: str, terms: Sequence[tuple[str, str]], sign: str = "+") -> str:
    """Return the text of `base` plus the products of the pairs `terms`.

    The last product is added last: the sum of the others need not wait for it. This sum is added to `base` at once,
    because each addition to `base`, which is larger, has a larger round-off.
    """
    products = [f"{factor} * {value}" for factor, value in terms]
    others = f"({base} {sign} ({' + '.join(products[:-1])}))" if products[1:] else base
    return f"{others} {sign} {products[-1]}"
