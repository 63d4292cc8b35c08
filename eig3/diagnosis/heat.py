"""Detect a run of Langevin dynamics that ends much hotter than its temperature."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..methods import Langevin
from ..stepping.stepper import Stepper

_HOT = 2.0  # relative to the temperature, and to the start
_CERTAIN = 60.0  # minus twice the logarithm of the chance to be as hot at the temperature, by Chernoff's bound


def heat(stepper: Stepper) -> str:
    """Describe an end that is hotter than the temperature allows; empty if it is not."""
    method = stepper.running
    if not isinstance(method, Langevin) or not method.temperature:
        return ""
    masses = np.broadcast_to(1.0 if method.mass is None else method.mass, stepper.n)
    has_noise = np.isfinite(masses)

    def hotness(v: Any) -> float:
        with np.errstate(over="ignore"):
            return float(np.mean(masses[has_noise] * np.ravel(v)[has_noise] ** 2) / method.temperature)

    if not has_noise.any():
        return ""
    end = hotness(stepper.v)
    if end < _HOT * max(1.0, hotness(stepper.start[1])):
        return ""
    if has_noise.sum() * (end - 1 - math.log(end)) < _CERTAIN:
        return ""
    return (
        f"At the end, m v^2 is {end:.3g} times the temperature on average: h = {stepper.h:g} is too long for the "
        "fastest motion, or the forces heat it faster than gamma cools it."
    )
