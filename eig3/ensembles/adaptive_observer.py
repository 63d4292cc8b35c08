"""The observer of members with tolerances in lanes: events, wanted times, quantities, and saved states."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..kernels.lane_observation import (
    END_EVENT,
    END_STEP,
    END_TIME,
    MOST_ROWS,
    OCCURRENCES,
    STATES,
    LaneObservation,
)
from ..kernels.loops.formulas import variable_formulas
from ..kernels.loops.observe import Observation, at_each_step, observation, placing
from ..kernels.loops.variable import own_degrees
from ..kernels.protocol import COLUMN, EVENT_VALUES, EVENTS, RECORD_SIZE, Look
from ..stepping.followed import OF_EXTREMES, OF_LATEST, OF_OUT, OF_START, OF_STEPS, spacing_of
from ..stepping.march import Rows
from ..stepping.observer import Observer
from .lanewise import Setup

_ROWS = 4096  # saved states of all lanes, after which the kernel returns


class AdaptiveObserver:
    """The observer of the lanes in which some members run one after another.

    The states at times of t_eval are written to the histories. Occurrences, and the states of save_every, are written
    to rows that all lanes share: each row knows its member.

    Attributes
    ----------
    record : LaneObservation
        The argument of the kernel.
    rows : Rows
        Where the kernel writes the states of save_every.
    every : int
        The distance of these states in steps, or 0.
    """

    def __init__(self, shared: Setup, numbers: np.ndarray, rtol: float) -> None:
        self._shared, self._numbers = shared, numbers
        histories, lanes, system = shared.histories, shared.layout.lanes, shared.prepared.system
        self._followed, self._n, times = system.followed, histories.members.n, histories.options.t_eval
        m, n, count = len(numbers), self._n, len(shared.places)
        formulas = variable_formulas(shared.method.variable)
        observer = Observer(system, times, n, formulas.work_rows)
        observer.look_within(formulas, rtol)
        self.every = 0 if histories.options.save_every is None else histories.every
        self.rows, self._outputs = self._shared_rows(observer, times)
        look = observer.arguments
        # There must be space for an event of each kind in each lane.
        self._log = np.empty((max(len(look.watch.log), 2 * lanes * count), 2 + 4 * n))
        look = look._replace(watch=look.watch._replace(log=self._log))
        values = np.full((lanes, len(observer.numbers)), np.nan)
        self._looks = np.empty((lanes, RECORD_SIZE))
        module, n_own = shared.method.variable, 0 if system.constrained_step else n
        parts = observation(module, system.form, own_degrees(system.form, n_own), system.parts or frozenset())
        place_look = placing()
        places = [place_look(self._look(look, mine), room) for mine, room in zip(values, self._looks, strict=True)]
        self.record = LaneObservation(
            Observation(0, 0, at_each_step(look.follow), *parts),
            np.array(places, dtype=np.int64),
            np.array([shared.events[k][0].address for k, _ in shared.places], dtype=np.int64),
            np.ones((count, lanes)),
            np.ones((count, lanes)),
            np.full(lanes, np.inf),
            np.full(lanes, np.inf),
            np.zeros((lanes, EVENTS + EVENT_VALUES * count)),
            spacing_of(histories.options.functions.invariants_every),
            np.zeros(2, dtype=np.int64),
            np.empty(len(self._log), dtype=np.int64),
            np.empty(len(self.rows.t), dtype=np.int64),
            values,
            np.empty((m, self._followed.begin_of(OF_OUT, n))),
            self._followed.begin_of(OF_START, n),
            np.full((m, 3), np.nan),
        )
        self._keeps = observer, look  # whose memory the kernel reads
        self._found = [(self.record.of_occurrences[:0], self._log[:0])]
        self._saved = [(self.record.of_states[:0], *(x[:0] for x in (*self.rows, *self._outputs.values())))]

    def _shared_rows(self, observer: Observer, times: np.ndarray | None) -> tuple[Rows, dict[str, np.ndarray]]:
        """Let the kernel write states to the histories or to shared rows, and return these rows and their outputs."""
        histories, n, mine = self._shared.histories, self._n, slice(self._numbers[0], self._numbers[-1] + 1)
        if times is not None:
            observer.save_wanted({name: getattr(histories, name)[mine] for name in ("u", "v", "steps")}, n)
            observer.save_outputs({name: whole[mine] for name, whole in histories.outputs.items()})
            return Rows(np.empty(0), np.empty(0), np.empty((0, n)), np.empty((0, n))), {}
        count = max(_ROWS, 4 * MOST_ROWS * self._shared.layout.lanes) if self.every else 0
        outputs = {name: np.empty((count, *whole.shape[2:])) for name, whole in histories.outputs.items()}
        observer.save_outputs(outputs)
        return Rows(np.empty(count), np.empty(count), np.empty((count, n)), np.empty((count, n))), outputs

    def _look(self, look: Look, numbers: np.ndarray) -> Look:
        """Return the look of a lane: what changes in it is a part of `numbers`."""
        if not self._followed.quantities:
            return look
        extremes, steps, _, before, out, parts, forward, most = self._followed.arrays(self._n, numbers)[1]
        changing = {"out": out, "extremes": extremes, "steps": steps, "parts": parts, "forward": forward, "most": most}
        return Look(look.watch, look.follow._replace(**changing), look.within._replace(before=before))

    def collect(self) -> None:
        """Take the rows that the kernel has written.

        Raises
        ------
        ValueError
            If a quantity has written beyond its values.
        """
        record, written = self.record, self.record.written
        if written[OCCURRENCES]:
            some = slice(written[OCCURRENCES])
            self._found.append((record.of_occurrences[some].copy(), self._log[some].copy()))
        if written[STATES]:
            some = slice(written[STATES])
            states = [x[some].copy() for x in (*self.rows, *self._outputs.values())]
            self._saved.append((record.of_states[some].copy(), *states))
        written[:] = 0
        if self._followed.writing:
            self._followed.check(self._followed.arrays_of_runs(self._n, record.numbers)[OF_OUT])

    def store(self, reached: np.ndarray, stopped: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
        """Store what was observed in the members of the mask `reached`, of which events have ended those in `stopped`.

        `u` and `v` are the ends of all members. Those that are not in `reached` run again alone.
        """
        histories, record, numbers = self._shared.histories, self.record, self._numbers
        chosen = numbers[reached]
        member, found = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        valid = reached[member]
        histories.note_events(numbers[member[valid]], found[valid])
        t, event = record.ends[stopped][:, [END_TIME, END_EVENT]].T
        histories.end_by_events(numbers[stopped], event, t)
        arrays = self._followed.arrays_of_runs(self._n, record.last_numbers[reached])
        if self._followed.quantities:
            self._store_quantities(chosen, arrays)
        if histories.options.t_eval is not None:
            for states in (histories.steps, histories.u, histories.v, *histories.outputs.values()):
                states[numbers[~reached]] = np.nan  # type: ignore[index]
            return
        saved = [np.concatenate(parts) for parts in zip(*self._saved, strict=True)]
        order = np.argsort(saved[0], kind="stable")
        order = order[reached[saved[0][order]]]
        place, *rows = (x[order] for x in saved)
        place = (np.cumsum(reached) - 1)[place]
        end, start = record.ends[reached].T, histories.members
        first = [start.t_span[0], 0.0, start.u0[chosen], start.v0[chosen], *self._outputs_in(arrays[OF_START])]
        last = [end[END_TIME], end[END_STEP], u[reached], v[reached], *self._outputs_in(arrays[OF_LATEST])]
        histories.save_rows(chosen, first, place, rows, last)

    def _store_quantities(self, chosen: np.ndarray, arrays: list[np.ndarray]) -> None:
        """Store the extremes and the drifts of members, from their arrays of an observer."""
        histories, followed = self._shared.histories, self._followed
        for name, k in (followed.invariants | followed.outputs).items():
            begin, width = int(followed.table[k, COLUMN]), followed.quantities[k].width
            for row, values in zip(histories.extremes[name], arrays[OF_EXTREMES].transpose(1, 0, 2), strict=True):
                row[chosen] = values[:, begin : begin + width].reshape(-1, *row.shape[1:])
        for name, k in followed.invariants.items():
            column = int(followed.table[k, COLUMN])
            (low, high), first = arrays[OF_STEPS][..., column].T, arrays[OF_START][:, column]
            histories.drift[name][chosen] = np.maximum(first - low, high - first)

    def _outputs_in(self, values: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the values of each output of members, from a row of all quantities for each."""
        followed = self._followed
        for name, k in followed.outputs.items():
            begin, shape = int(followed.table[k, COLUMN]), self._shared.histories.outputs[name].shape[2:]
            yield values[:, begin : begin + followed.quantities[k].width].reshape(-1, *shape)
