"""The observed invariants and outputs of a system, and their places in arrays."""

from __future__ import annotations

import math

import numpy as np

from ..functions.guard import GUARD_VALUES, are_untouched
from ..functions.quantities import Functions, Quantity
from ..kernels.protocol import OUT, PARTS, Form, Within

_OFF_PERIOD = (math.sqrt(5) - 1) / 2  # the inverse of the golden ratio, which is far from all simple fractions


def spacing_of(every: int) -> float:
    """Return the entry `SPACING` of the counters for invariants that are evaluated after about every so many steps."""
    return 1.0 if every == 1 else every + _OFF_PERIOD


def n_invariants(n_steps: int, spacing: float) -> int:
    """Return after how many steps of a run `kernels.loops.follow.next_due` lets its invariants be evaluated."""
    count, due = 0, 1.0
    while due <= n_steps and due < 8 * spacing and spacing > 1:
        count, due = count + 1, due + max(1.0, due / 8)
    return count + max(0, int((n_steps - due) / spacing + 1))


#: The places of some arrays in what `Followed.arrays` returns. The first four are what remains of a run.
OF_EXTREMES, OF_STEPS, OF_START, OF_LATEST, OF_OUT = range(5)


class Followed:
    """The quantities that runs of a system evaluate at each step, and their places in the arrays of an `Observer`.

    Attributes
    ----------
    quantities : list of Quantity
        The invariants, then the outputs.
    invariants, outputs : dict of str to int
        The number of each quantity, by its name.
    work : list of int
        For each quantity, the degree of freedom whose velocity is the work that it subtracts, or -1.
    writing : list of int
        The numbers of the quantities that write their values.
    columns : int
        The number of values of all quantities.
    advance : int
        The address of the function that advances the history of a right-hand side, or 0.
    project : int
        The address of the function that projects a state onto the constraints, or 0.
    """

    def __init__(self, functions: Functions, form: Form, advance: int = 0, project: int = 0) -> None:
        invariants, outputs = functions.quantities(form)
        self.advance, self.project = advance, project
        self.functions = functions
        self.quantities: list[Quantity] = [*invariants.values(), *outputs.values()]
        self.invariants = {name: k for k, name in enumerate(invariants)}
        self.outputs = {name: len(invariants) + k for k, name in enumerate(outputs)}
        self.work = [-1] * len(self.quantities)
        for name, k in self.invariants.items():
            work = functions.work_in(name)
            self.work[k] = -1 if work is None else work
        self.writing = [k for k, quantity in enumerate(self.quantities) if quantity.shape]
        self.table = np.zeros((len(self.quantities), 6), dtype=np.int64)
        self.columns, size = 0, GUARD_VALUES
        for k, quantity in enumerate(self.quantities):
            width = quantity.width if quantity.shape else 0
            self.table[k] = quantity.callback.address, width, self.columns, size, 0, self.work[k]
            self.columns += quantity.width
            size += quantity.width + GUARD_VALUES
        self._out_size = size
        self._places: dict[int, tuple[int, list[tuple[int, int, tuple[int, ...]]]]] = {}
        self._idle: dict[int, tuple[np.ndarray, list[np.ndarray]]] = {}
        self.idle_within: dict[int, Within] = {}

    @property
    def is_needed(self) -> bool:
        """Whether a run does something after each step."""
        return bool(self.quantities or self.advance or self.project)

    def arrays(self, n: int, numbers: np.ndarray | None = None) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return all numbers that change during a run, and arrays that are views of them.

        Runs without quantities share these arrays for each n, because nothing changes in them.
        """
        if not self.quantities and n in self._idle:
            return self._idle[n]
        size, places = self._places_of(n)
        numbers = np.zeros(size) if numbers is None else numbers
        found = numbers, [numbers[begin:end].reshape(shape) for begin, end, shape in places]
        if not self.quantities:
            self._idle[n] = found
        return found

    def arrays_of_runs(self, n: int, numbers: np.ndarray) -> list[np.ndarray]:
        """Return these arrays of several runs, from their numbers, or the first numbers, of shape (runs, k)."""
        _, places = self._places_of(n)
        some = (place for place in places if place[1] <= numbers.shape[1])
        return [numbers[:, begin:end].reshape(len(numbers), *shape) for begin, end, shape in some]

    def begin_of(self, array: int, n: int) -> int:
        """The first of the numbers that belong to an array, such as `OF_START`."""
        return self._places_of(n)[1][array][0]

    def check(self, out: np.ndarray) -> None:
        """Raise a ValueError if a quantity has written beyond its values in the last axis of an array."""
        for k in self.writing:
            begin = int(self.table[k, OUT])
            end = begin + self.quantities[k].width
            guards = out[..., begin - GUARD_VALUES : begin], out[..., end : end + GUARD_VALUES]
            if not all(map(are_untouched, guards)):
                raise self.quantities[k].written_beyond()

    def _places_of(self, n: int) -> tuple[int, list[tuple[int, int, tuple[int, ...]]]]:
        """Return what `_placed` returns, from its first call for each n."""
        return self._places.get(n) or self._places.setdefault(n, self._placed(n))

    def _placed(self, n: int) -> tuple[int, list[tuple[int, int, tuple[int, ...]]]]:
        """Return the total count of numbers, and the begin, the end and the shape of each array in them."""
        columns, places, size = self.columns, [], 0
        shapes: list[tuple[int, ...]] = [
            (4, columns),  # the extremes
            (2, columns),  # extremes over the ends of steps and events
            (columns,),  # the values at the start
            (columns,),  # the values before the next step
            (self._out_size,),  # the values in the latest state
            (PARTS, 2, columns),  # extremes in the last parts of the run
            (PARTS, n),  # the signs of the velocities at the ends of these parts
            (len(self.quantities),),  # the largest |work|
        ]
        for shape in shapes:
            places.append((size, size + math.prod(shape), shape))
            size += math.prod(shape)
        return size, places
