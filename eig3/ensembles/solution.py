"""The result of an ensemble: the histories of its members, their status and their extremes."""

from __future__ import annotations

import collections
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback
from ..functions.companions import history_of
from ..functions.evaluation import accelerations
from ..functions.extremes import Extremes
from ..functions.first_order import FirstOrder, check_z0, is_bound
from ..functions.guard import guarded
from ..functions.layout import Layout, bound_layout
from ..kernels.compile.interrupt import with_solution
from ..kernels.protocol import SCALAR, VECTOR
from ..keywords import with_suggestions
from ..methods import Method
from ..notebook import of_repr
from ..result import frames
from ..result.columns import OF_RUNS, OF_STATES, each
from ..result.labels import Labels
from ..result.solution import Reason, Solution, Status, drifts
from ..stepping.march import Cancel
from . import files
from .occurrences import MemberOccurrences

#: The fields that a copy and a pickle do not keep; a file keeps the error.
_TRANSIENT = "_rhs", "_repeat", "_again", "_resume", "_with_functions", "error"

#: Runs one member alone, by its number.
Repeat = Callable[[int], Solution]


@dataclass(repr=False, eq=False)
class EnsembleSolution:
    """The histories of m members, with s saved states each.

    Attributes
    ----------
    t : ndarray, shape (m, s)
        Times of the saved states. If all members have the same times, this is a read-only view of one row.
    u, v : ndarray, shape (m, s) or (m, s, n)
        Displacements and velocities. The states after the end of a member are NaN: after the last finite state of a
        member that diverged, and after the last state of a member with fewer steps than others.
    h : ndarray, shape (m,)
        The step of each member; with tolerances, the mean of its steps.
    n_steps : ndarray of int, shape (m,)
        Number of steps that each member took.
    n_rhs : ndarray of int, shape (m,)
        Number of evaluations of the right-hand side for each member.
    n_iterations : ndarray of int, shape (m,)
        Number of iterations of an implicit method's solver for each member.
    status : ndarray of Status, shape (m,)
        How each member ended.
    message : ndarray of str, shape (m,)
        A sentence about how each member ended.
    drift : dict of str to ndarray, shape (m,)
        For each invariant e, the maximum of |e_n - e_0| over the ends of `n_invariants` steps; NaN if e became NaN.
    extremes : dict of str to Extremes
        For each invariant and each output, its minimum `low` and its maximum `high` over the ends of all steps, and
        their times `t_low` and `t_high`: arrays of shape (m,), or (m, k) for an output with k values.
    outputs : dict of str to ndarray, shape (m, s) or (m, s, k)
        The values of each output at the saved states.
    params : ndarray, shape (m, k) or (k,)
        The parameters of each member, or of all of them.
    first : int
        The number of the first member in the whole ensemble; it is not 0 in a part that `reduce` gets.
    kernel_seconds : float
        Time in the kernels, s, summed over the threads, without compilation.
    method : Method
        The method as it was requested.
    z : dict of str to ndarray, shape (m, s) or (m, s, k)
        The first-order unknowns, by the names of z0.
    events : dict of str to MemberOccurrences
        The occurrences of each event: `member`, `t`, `u`, `v`, `u_after` and `v_after` in the order of members and
        times, and `first`, the time of the first occurrence in each member, of shape (m,), or NaN.
    n_rejected : ndarray of int, shape (m,)
        With tolerances, the number of steps of each member that were repeated with a shorter step.
    n_invariants : ndarray of int, shape (m,)
        The number of steps of each member after which its invariants were evaluated: see `Solution`.
    steps : ndarray, shape (m, s), or None
        With tolerances, the length of the step that led to each saved state, or that contains its time; NaN for the
        end of a member that ran in lanes in which nothing was observed.
    notes : tuple of str
        Sentences that the user should read, such as that rhs could not be vectorised.
    labels : Labels or None
        Names and units of the degrees of freedom, in an ensemble of a problem.
    error : MemberErrors or None
        With ``check=True``: ``error[i]`` is None if the member failed or was interrupted. Files keep it, copies do not.
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    h: np.ndarray
    n_steps: np.ndarray
    n_rhs: np.ndarray
    n_iterations: np.ndarray
    status: np.ndarray
    message: np.ndarray
    params: np.ndarray
    method: Method
    drift: dict[str, np.ndarray] = field(default_factory=dict)
    extremes: dict[str, Extremes] = field(default_factory=dict)
    outputs: dict[str, np.ndarray] = field(default_factory=dict)
    first: int = 0
    kernel_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    z: dict[str, np.ndarray] = field(default_factory=dict)
    events: dict[str, MemberOccurrences] = field(default_factory=dict)
    n_rejected: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    n_invariants: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    steps: np.ndarray | None = None
    labels: Labels | None = None
    error: Any = None
    _last: dict[int, dict[str, Any]] = field(default_factory=dict)  # columns of a last state that is not a saved state
    _rhs: Any = None  # the jitted function
    _repeat: Repeat | None = None
    _again: Callable[..., EnsembleSolution] | None = None  # runs all members to another end
    _resume: Callable[..., EnsembleSolution] | None = None  # runs the members that are not in the directory
    _with_functions: Callable[..., EnsembleSolution] | None = None  # the same, with the functions of the ensemble

    @property
    def success(self) -> np.ndarray:
        """A mask of shape (m,): the members whose status is COMPLETED or TERMINATED."""
        return (self.status == Status.COMPLETED) | (self.status == Status.TERMINATED)

    @property
    def a(self) -> np.ndarray | None:
        """The accelerations f(t, u, v) at the saved states, in an array of the shape of u.

        They are evaluated at each access. None without a right-hand side, as in a copy.
        """
        if self._accelerations_of(0) is None:
            return None
        found = np.full(self.u.shape, np.nan)
        for i, count in enumerate(self._n_rows()):
            rows = slice(count)
            if is_bound(self._rhs):
                found[i, rows] = self[i].a[rows]  # type: ignore[index]
            else:
                found[i, rows] = self._accelerations_of(i)(self.t[i, rows], self.u[i, rows], self.v[i, rows])
        return found

    def __len__(self) -> int:
        return len(self.u)

    def __iter__(self) -> Iterator[Solution]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> Solution:
        """Return member i, whose history ends at its last finite state."""
        if not isinstance(i, int | np.integer):
            raise TypeError("an ensemble has one index, the number of a member; index its arrays u, v and t instead.")
        if not -len(self) <= i < len(self):
            raise IndexError(f"the ensemble has {len(self)} members, numbered from 0: there is no member {i}.")
        i = int(i) % len(self)
        count = int(self._n_rows(slice(i, i + 1))[0])
        fields = {name: each(lambda x: x[i, :count], getattr(self, name)) for name in OF_STATES}
        fields |= {name: each(lambda x: x.item(i) if x.ndim == 1 else x[i], getattr(self, name)) for name in OF_RUNS}
        for name, last in self._last.get(i, {}).items():  # save_every does not include the last finite state
            fields[name] = each(lambda x, y: np.append(x, [y], axis=0), fields[name], last)
        member = Solution(
            **fields,
            kernel_seconds=self.kernel_seconds * float(self.n_steps[i] / max(1, self.n_steps.sum())),
            method=self.method.of_member(self.first + i),
            notes=self.notes,
            events={name: occurrences.of_member(i) for name, occurrences in self.events.items()},
            labels=self.labels,
            reason=self._reason(i),
            _accelerations=self._accelerations_of(i),
        )
        member._reads_z = is_bound(self._rhs)
        return member

    def _n_rows(self, chosen: slice = slice(None)) -> np.ndarray:
        """Return the number of finite saved states of some members; all finite states come first."""
        u, v = self.u[chosen], self.v[chosen]
        if np.isfinite(u[:, -1:]).all() and np.isfinite(v[:, -1:]).all():
            return np.full(len(u), u.shape[1])
        finite = np.isfinite(u) & np.isfinite(v)
        return np.count_nonzero(finite if finite.ndim == 2 else finite.all(axis=2), axis=1)

    def _table(self) -> SimpleNamespace:
        """Return the columns of all states, including a last state that save_every does not include."""
        counts, rows = self._n_rows(), self.u.shape[1]
        member = np.repeat(np.arange(len(self)), counts)
        chosen = None if (counts == rows).all() else np.arange(rows) < counts[:, None]

        def taken(x: np.ndarray) -> np.ndarray:
            return x.reshape(len(member), *x.shape[2:]) if chosen is None else x[chosen]

        fields = {name: each(taken, getattr(self, name)) for name in OF_STATES}
        if self._last:
            numbers = sorted(self._last)
            ends = np.cumsum(counts)[numbers]
            member = np.insert(member, ends, numbers)
            for name in self._last[numbers[0]]:
                states = (self._last[i][name] for i in numbers)
                fields[name] = each(lambda x, *last: np.insert(x, ends, last, axis=0), fields[name], *states)
        return SimpleNamespace(**fields, member=self.first + member, labels=self.labels)

    @property
    def _layout(self) -> Layout | None:
        """The names of the parameters; without the labels of a problem, a copy does not have them."""
        text = self.labels.layout if self.labels else ""
        return Layout.of_text(text) if text else bound_layout(self._rhs)

    def summary(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each member.

        Returns
        -------
        pandas.DataFrame
            The index is the number of the member in the whole ensemble. The columns are the parameters that differ
            between members, without arrays of more than 24 values, as p.h if another column is h; status, h, n_steps
            and n_rhs; the drift of each invariant; for each event, its count and the time of its first occurrence, NaN
            without one; the minimum and the maximum of each invariant and output, their times, and the peak, the
            maximum of the size; and the time and the values of the last finite state, named as by `to_pandas`.

        Raises
        ------
        ImportError
            If pandas is not installed.
        ValueError
            If two columns have the same name.
        """
        return frames.ensemble_summary(self)

    def to_xarray(self) -> Any:
        """Return the saved states of all members as an `xarray.Dataset`.

        Returns
        -------
        xarray.Dataset
            As for a `Solution`, with a first axis member, the number of the member in the whole ensemble. If the
            members have different times, the second axis is row, and the coordinate t has the times. Variables over
            member are h, n_steps, status, and for each event its count and the time of its first occurrence, named as
            by `summary`; the parameters that differ between members are coordinates over member.

        Raises
        ------
        ImportError
            If xarray is not installed.
        ValueError
            If two variables have the same name.
        """
        return frames.ensemble_to_xarray(self)

    def to_pandas(self) -> Any:
        """Return the saved states of all members as a `pandas.DataFrame`, with a row for each state of each member.

        Returns
        -------
        pandas.DataFrame
            The columns member, the number of the member in the whole ensemble, and t; then the columns as for a
            `Solution`. `attrs` has the method and the units. States after the end of a member are left out.

        Raises
        ------
        ImportError
            If pandas is not installed.
        ValueError
            If two columns have the same name.
        """
        return frames.ensemble_to_pandas(self)

    @with_suggestions()
    def extend(
        self, t_end: float, *, t_eval: ArrayLike | None = None, progress: bool = False, cancel: Cancel | None = None
    ) -> EnsembleSolution:
        """Return the ensemble over a longer span, bitwise as one run over it.

        The members run again from their start, in this process and on all cores: a block keeps no state.

        Parameters
        ----------
        t_end : float
            The new end. With fixed steps, it is a whole number of steps after the end of each member.
        t_eval : array_like, optional
            For an ensemble with `t_eval`: further times, after the end, at which the states are saved.
        progress, cancel
            As for `eig3.ensemble`.

        Raises
        ------
        ValueError
            If t_end is not later, or not a whole number of steps after the end; or if this is a copy, a part or a file,
            which do not have the functions.
        """
        if self._again is None:
            raise ValueError(
                "this ensemble cannot be extended: it was copied, loaded or is a part; extend the solution that "
                "eig3.ensemble returned."
            )
        return self._again(t_end, t_eval, progress, cancel)

    def resume(
        self,
        *,
        threads: int | None = None,
        executor: Executor | None = None,
        progress: bool = False,
        cancel: Cancel | None = None,
    ) -> EnsembleSolution:
        """Run the members that are not finished in the directory of `save_to`, and return the ensemble.

        The result is bitwise the same as without an interruption. Finished parts are read and do not run again. A part
        that was interrupted runs again from its start.

        Parameters
        ----------
        threads, executor, progress, cancel
            As for `eig3.ensemble`.

        Returns
        -------
        EnsembleSolution
            Another object: this one does not change.

        Raises
        ------
        ValueError
            If this ensemble has no directory; if it was loaded without functions; or if the code of a function, or the
            numbers that it reads from outside, differ from the ensemble in the directory.
        TypeError, MemoryError, OSError, KeyboardInterrupt
            As for `eig3.ensemble`.
        """
        if self._resume is None:
            why = "it was not written by save_to, or is a copy; run eig3.ensemble(..., save_to=DIR)"
            if self._with_functions:
                why = "it was loaded without functions; give load the functions of the ensemble, such as rhs"
            raise ValueError(f"this ensemble cannot be resumed: {why}.")
        return self._resume(threads=threads, executor=executor, progress=progress, cancel=cancel)

    @with_solution
    def save(self, path: str | PathLike[str]) -> Path:
        """Write the ensemble to a file of NumPy arrays, which `eig3.load` reads.

        Parameters
        ----------
        path : str or path
            The file, which is replaced if it exists; ".npz" is added if it does not end with this.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        OSError
            If the file cannot be written.
        TypeError
            If the method is not one of `eig3.METHODS`.
        """
        return files.save(self, path)

    def with_functions(
        self, rhs: Any, events: Any = None, invariants: Any = None, outputs: Any = None, jacobian: Any = None
    ) -> EnsembleSolution:
        """Give a loaded ensemble its functions, and return it; in a file, it takes only the right-hand side."""
        given = {"events": events, "invariants": invariants, "outputs": outputs, "jacobian": jacobian}
        for name, value in given.items():
            if value is not None and self._with_functions is None:
                raise ValueError(f"{name} is for single runs: a loaded ensemble cannot be continued.")
            if value is not None and rhs is None:
                raise ValueError(f"{name} needs rhs too: the right-hand side of the ensemble.")
        if self._with_functions and rhs is not None:
            self._resume = partial(self._with_functions, self.params, rhs, given)
        if rhs is not None:
            # not the values, which are NaN in a member that is not finished or ended before t_eval
            unknowns, _ = check_z0(rhs, {name: np.zeros(x.shape[2:]) for name, x in self.z.items()} or None)
            self._rhs = unknowns.bind_rhs(rhs)
        return self

    def _separate(self, unknowns: FirstOrder) -> None:
        """Move first-order unknowns, which are the velocities of the last degrees of freedom, to `z`."""
        self.u, self.v, self.z = unknowns.separated(self.u, self.v)
        for i, last in self._last.items():
            states = unknowns.separated(last["u"], last["v"])
            self._last[i] = last | dict(zip(("u", "v", "z"), states, strict=True))

    def _place(self, part: EnsembleSolution) -> None:
        """Store the results of some of the members, from member `part.first` on."""
        chosen, rows = slice(part.first, part.first + len(part)), part.u.shape[1]
        self._reserve(rows)

        def put(whole: np.ndarray, values: np.ndarray) -> None:
            whole[chosen, :rows], whole[chosen, rows:] = values, np.nan

        for name in OF_STATES:
            if name != "t" or self.t.strides[0]:  # the times of all members may be the same
                each(put, getattr(self, name), getattr(part, name))
        for name in OF_RUNS:
            each(lambda whole, values: whole.__setitem__(chosen, values), getattr(self, name), getattr(part, name))
        for name, occurrences in part.events.items():
            self.events[name] = self.events[name].with_part(occurrences, part.first)
        self._last |= {part.first + i: state for i, state in part._last.items()}
        self.kernel_seconds += part.kernel_seconds
        self.notes = (*dict.fromkeys((*self.notes, *part.notes)),)  # each note once

    def _reserve(self, rows: int) -> None:
        """Make room for more states of each member."""
        if rows > self.u.shape[1]:
            for name in OF_STATES:
                setattr(self, name, each(partial(widened, rows), getattr(self, name)))

    def _accelerations_of(self, i: int) -> Any:
        """Return the function of the accelerations of member i, if one is known."""
        if self._rhs is None or history_of(self._rhs):
            return None
        params = guarded(self.params[i] if self.params.ndim == 2 else self.params)
        return partial(self._accelerations, self._rhs, params)

    @staticmethod
    def _accelerations(rhs: Any, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Evaluate the accelerations of a member. After a run on other machines, rhs is compiled only here."""
        return accelerations(check_callback(rhs, "rhs", SCALAR if u.ndim == 1 else VECTOR), params, t, u, v)

    def _reason(self, i: int) -> Reason | None:
        """Return the function that explains why member i diverged. It repeats the member as a single run."""
        repeat = self._repeat
        if repeat is None or self.status[i] is not Status.DIVERGED:
            return None
        return lambda: repeat(i).explain()

    def __getstate__(self) -> dict[str, Any]:
        # These functions refer to compiled code. Members with the same times share them.
        state = {name: value for name, value in vars(self).items() if name not in _TRANSIENT}
        return state | {"t": self.t if self.t.strides[0] else self.t[:1]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if len(self.t) < len(self):
            self.t = np.broadcast_to(self.t, self.u.shape[:2])

    def __repr__(self) -> str:
        n = 1 if self.u.ndim == 2 else self.u.shape[2]
        steps = _extent(self.n_steps, "{:d}")
        total = int(self.n_steps.sum())
        lines = [
            f"EnsembleSolution by {self.method!r}: {len(self)} members, {self._counts()}",
            f"  {n} degree{'s' * (n > 1)} of freedom, t = {self.t[0, 0]:g} to {np.nanmax(self.t):g}, {steps} steps of "
            f"h = {_extent(self.h, '{:.6g}')}, {self.u.shape[1]} states saved",
            f"  {self.kernel_seconds:.3g} s in the kernels ({1e9 * self.kernel_seconds / max(1, total):.3g} ns a step "
            "and member)",
        ]
        lines += drifts(self, "at most ")
        lines += [f"  {self.error!r}"] * (self.error is not None)
        lines += [f"  Note: {note}" for note in self.notes]
        return "\n".join(lines)

    _repr_html_ = of_repr

    def _counts(self) -> str:
        counts = collections.Counter(self.status.tolist())
        return ", ".join(f"{counts[status]} {status.value}" for status in Status if counts[status])


files.register(EnsembleSolution)

#: A function that returns the values that the caller needs from a part of an ensemble.
Reduce = Callable[[EnsembleSolution], Any]


def _extent(values: np.ndarray, form: str) -> str:
    low, high = (form.format(x) for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def widened(rows: int, values: np.ndarray) -> np.ndarray:
    """Return an array with NaN in further rows of its second axis."""
    wide = np.full((len(values), rows, *values.shape[2:]), np.nan)
    wide[:, : values.shape[1]] = values
    return wide
