"""The values of a swept parameter: a grid, or a random sample."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from ..command_line import MOST_DIGITS
from ..methods import shown

_NUMBER = r"[^:=]+"
_FORM = re.compile(rf"([^:=]+)=({_NUMBER}):({_NUMBER})(?::(\d+))?(:log)?")
MOST_WHOLE = 2.0**53  # largest whole number as a parameter; not every larger whole number is a float
_NEAR = 1e-9  # relative distance within which a value is rounded to a whole number: a logarithmic grid has round-off


@dataclass(frozen=True)
class Axis:
    """A swept parameter from `low` to `high`: a grid with `count` values, or without a count a random sample.

    With `is_log`, the values are spaced, or distributed, uniformly in the logarithm.
    """

    name: str
    low: float
    high: float
    count: int | None
    is_log: bool = False

    @classmethod
    def parse(cls, text: str, *, random: bool) -> Axis:
        """Return the axis of ``NAME=FROM:TO:COUNT`` or, for a random sample, ``NAME=FROM:TO``; ``:log`` may follow.

        Raises
        ------
        ValueError
            If the text has another form, or the values are not valid.
        """
        form, example = ("NAME=FROM:TO", "omega=0.5:2") if random else ("NAME=FROM:TO:COUNT", "omega=0.5:2:100")
        match = _FORM.fullmatch(text.replace(" ", ""))
        wrong = ValueError(
            f"--set must be {form} or {form}:log{' with --random' if random else ''}, such as {example}, not "
            f"{shown(text)}."
        )
        if not match or bool(match[4]) == random:
            raise wrong
        try:
            low, high = float(match[2]), float(match[3])
        except ValueError:
            raise wrong from None
        name, is_log = match[1], bool(match[5])
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"--set {name} must go from a number to a larger number, not from {low:g} to {high:g}.")
        if is_log and low <= 0:
            raise ValueError(f"--set {name} must start above 0 for logarithmic spacing, not at {low:g}.")
        digits = (match[4] or "").lstrip("0")
        if len(digits) > MOST_DIGITS:
            raise ValueError(f"--set {name} cannot have so many values: their number has {len(digits)} digits.")
        count = None if random else int(digits or 0)
        if count is not None and count < 2:
            raise ValueError(f"--set {name} must have at least 2 values, not {count}.")
        return cls(name, low, high, count, is_log)

    def grid(self, *, whole: bool) -> np.ndarray:
        """Return evenly spaced values, which must be whole numbers if `whole`."""
        assert self.count is not None
        self._check_whole(whole)
        values = (np.geomspace if self.is_log else np.linspace)(self.low, self.high, self.count)
        if not whole:
            return values
        rounded = np.rint(values)
        far = np.abs(values - rounded) > _NEAR * np.abs(values)
        if far.any():
            raise ValueError(
                f"--set {self.name} takes whole numbers, but {self.count} values from {self.low:g} to {self.high:g} "
                f"contain {values[far][0]:g}."
            )
        return rounded.astype(np.int64)

    def sample(self, rng: np.random.Generator, count: int, *, whole: bool) -> np.ndarray:
        """Return random values with a uniform distribution; with `whole`, each whole number is equally likely."""
        self._check_whole(whole)
        if whole:
            if self.is_log or not (self.low.is_integer() and self.high.is_integer()):
                raise ValueError(f"--set {self.name} takes whole numbers: give whole FROM and TO, without log.")
            return rng.integers(int(self.low), int(self.high) + 1, count)
        if self.is_log:
            return np.exp(rng.uniform(math.log(self.low), math.log(self.high), count))
        return rng.uniform(self.low, self.high, count)

    def _check_whole(self, whole: bool) -> None:
        if whole and max(abs(self.low), abs(self.high)) > MOST_WHOLE:
            raise ValueError(f"--set {self.name} takes whole numbers below 2^53, not up to {self.high:g}.")
