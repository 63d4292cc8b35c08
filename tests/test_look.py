"""What kernels look for and follow: direct calls, compared with plain kernels and with evaluation in Python."""

from types import SimpleNamespace

import numpy as np
import pytest

import eig3
from eig3.functions.callbacks import check_callback
from eig3.functions.guard import guarded
from eig3.kernels.loops import fixed, variable
from eig3.kernels.loops.formulas import variable_formulas
from eig3.kernels.loops.observe import Observation
from eig3.kernels.loops.pair import A, U, V
from eig3.kernels.protocol import (
    AT_END,
    BEFORE_END,
    ENDED_BY,
    ERROR,
    EVENT_VALUES,
    EVENTS,
    FAILED,
    FOLLOWS,
    FULL,
    GOING,
    HIGH,
    LOGGED,
    LOW,
    NEXT,
    PART,
    PART_END,
    PARTS,
    SCALAR,
    SEARCHES,
    T_HIGH,
    T_LOW,
    TERMINAL,
    TIME,
    VECTOR,
    ZENO,
    Follow,
    Look,
    Span,
    Steps,
    Watch,
)
from eig3.result.memory import aligned
from eig3.stepping.samples import within_steps

from .conftest import falling, first_position, hardening, hardening_chain, harmonic, oscillator, position, velocity

PARAMS = np.array([3.0, 0.1, 2.0])

energy = eig3.jit(lambda t, u, v, p: v * v / 2 + p[0] * (u * u / 2 + u**4 / 4))


@eig3.jit
def both(t, u, v, p, out):
    out[0], out[1] = u, t * v


middle = eig3.jit(lambda t, u, v, p: u[1] * v[2])


@eig3.jit
def ends(t, u, v, p, out):
    out[0], out[1] = u[0], v[u.size - 1]


@eig3.jit
def root(t, u, v, p):
    return np.sqrt(u)  # NaN for a negative u


@eig3.jit
def half_written(t, u, v, p, out):
    out[0] = u


bounce = eig3.jit(lambda t, u, v, p: (u, -p[1] * v))


@eig3.jit
def turn(t, u, v, p):
    v[0] = -v[0]


product = eig3.jit(lambda t, u, v, p: u * v)


@eig3.jit
def pair(t, u, v, p, a):
    a[0], a[1], a[2] = -u[0], 0.0, -4 * u[2]


def look_of(form, n, start, *, work_rows, quantities=(), events=(), times=(), rows=0, formulas=None, log=64):
    """Make a look from jitted functions, as it is at the start (t0, u0, v0, p) of a run.

    A quantity is a triple of a function, its number of values or 0, and the degree of freedom of the work or -1. An
    event is a quadruple of g, apply or None, the direction, and whether it is terminal. For each quantity, `saved` has
    an array of `rows` rows. With `formulas`, the look is for a kernel with tolerances.
    """
    t0, u0, v0, p = start
    callbacks = [check_callback(q, "output" if w else "invariant", form, "quantity") for q, w, _ in quantities]
    widths = [max(w, 1) for _, w, _ in quantities]
    columns, places = np.cumsum([0, *widths]), np.cumsum([0, *(w + 3 for w in widths)])
    saved = [np.full((rows, w), np.nan) for w in widths]
    table = [
        (callback.address, w, columns[k], places[k], saved[k].ctypes.data if rows else 0, work)
        for k, (callback, (_, w, work)) in enumerate(zip(callbacks, quantities, strict=True))
    ]
    out = np.full(places[-1], 7.5)  # so is every cell between the quantities
    for k, (callback, w) in enumerate(zip(callbacks, widths, strict=True)):
        if quantities[k][1]:
            values = np.full(w, np.nan)
            callback.call(t0, u0, v0, p, values)
        else:
            values = callback.call(t0, u0, v0, p)
        out[places[k] : places[k] + w] = values
    values = np.concatenate([np.empty(0), *(out[places[k] : places[k] + w] for k, w in enumerate(widths))])
    parts = np.empty((PARTS, 2, columns[-1]))
    parts[:, LOW], parts[:, HIGH] = np.inf, -np.inf
    parts[0] = values
    follow = Follow(
        np.array(table, dtype=np.int64).reshape(-1, 6),
        out,
        np.stack([values, values, np.full_like(values, t0), np.full_like(values, t0)]),
        np.stack([values, values]),
        parts,
        np.zeros((PARTS, n)),
        np.array([abs(np.atleast_1d(v0)[q[2]]) if q[2] >= 0 else 0.0 for q in quantities]),
    )
    gs = [check_callback(g, "event", form, "g") for g, *_ in events]
    applies = [apply and check_callback(apply, "apply", form, "apply") for _, apply, *_ in events]
    watch = Watch(
        np.array(
            [
                (g.address, a.address if a else 0, *e[2:], 1, 0, 0, 0)
                for g, a, e in zip(gs, applies, events, strict=True)
            ],
            dtype=np.int64,
        ).reshape(-1, 8),
        np.empty((log if events else 0, 2 + 4 * n)),
        np.array(times, dtype=np.float64),
        np.empty(len(times)),
        np.empty((len(times), n)),
        np.empty((len(times), n)),
        np.empty((work_rows, n)),
        np.empty((4, len(events))),
    )
    counters = np.zeros(EVENTS + EVENT_VALUES * len(events))
    of_events = counters[EVENTS:].reshape(-1, EVENT_VALUES)
    of_events[:, 0], of_events[:, 1] = [g.call(t0, u0, v0, p) for g in gs], -np.inf
    counters[TIME], counters[PART_END] = t0, 1
    if formulas is None:
        look = Look(watch, follow)
    else:
        look = Look(watch, follow, within_steps(values, n, formulas, np.zeros(len(quantities))))
    return SimpleNamespace(look=look, follow=follow, watch=watch, counters=counters, saved=saved, callbacks=callbacks)


def level(looked_for):
    """What a kernel must look for."""
    return SEARCHES if {"events", "times"} & looked_for.keys() else FOLLOWS if looked_for else 0


def form_of(u0):
    return SCALAR if np.ndim(u0) == 0 else VECTOR


def start_of(u0, v0, t0=0.0, params=PARAMS):
    if np.ndim(u0):
        u0, v0 = np.array(u0), np.array(v0)
    return t0, u0, v0, guarded(params)


class FixedRun:
    """A run of a fixed-step kernel, with a look if something is asked for, in one or more calls."""

    def __init__(self, method, rhs, start, h, every=1, rows=0, inline=False, **looked_for):
        t0, u0, v0, self.p = start
        self.h, self.t0, self.every, self.index, self.row = h, t0, every, 0, 0
        form, n = form_of(u0), np.size(u0)
        running = method.for_force(not method.ignores_velocity, n)
        formulas, order = running.formulas, method.order
        callback = check_callback(rhs, "rhs", form)
        a = np.empty(n)
        if form is SCALAR:
            a = callback.call(t0, u0, v0, self.p)
        else:
            callback.call(t0, u0, v0, self.p, a)
        self.state = aligned((formulas.state_rows(n), n))
        for k, values in enumerate((u0, v0, *formulas.start(u0, v0, a, h))):
            self.state[k] = values
        self.settings = np.array(running.settings, dtype=np.float64)
        self.counters, self.look = np.zeros(EVENTS), None
        looks = level(looked_for)
        if looks:
            made = look_of(form, n, start, work_rows=fixed.work_rows(formulas, order), rows=rows, **looked_for)
            vars(self).update(vars(made))
        if inline:
            quantities = tuple((q, w) for q, w, _ in looked_for.get("quantities", ()))
            self.kernel = fixed.inline_kernel(formulas, order, form, n, rhs, None, looks=looks, quantities=quantities)
        else:
            self.kernel = fixed.kernel(formulas, order, form, n, looks=looks)
        self.rhs = callback.address, None
        self.u, self.v = np.empty((2, rows) if form is SCALAR else (2, rows, n))

    def take(self, count):
        """Take steps, and return how the call ended."""
        u, v = (x.reshape(len(x), self.state.shape[1]) for x in (self.u, self.v))
        steps = Steps(self.h, self.t0, self.p, self.index, count, self.every, self.row, u, v)
        taken, self.row, ended = self.kernel(self.rhs, self.state, self.settings, self.counters, steps, self.look)
        self.index += taken
        return ended


class VariableRun:
    """A run of a kernel with tolerances, to its end."""

    def __init__(self, module, rhs, start, t_end, rtol, every=1, rows=0, **looked_for):
        t0, u0, v0, self.p = start
        form, n = form_of(u0), np.size(u0)
        formulas = variable_formulas(module)
        callback = check_callback(rhs, "rhs", form)
        self.state, a = aligned((formulas.rows, n)), np.empty(n)
        if form is SCALAR:
            a = callback.call(t0, u0, v0, self.p)
        else:
            callback.call(t0, u0, v0, self.p, a)
        self.state[U], self.state[V], self.state[A] = u0, v0, a
        self.counters, self.look, parts = np.zeros(EVENTS), None, None
        if looked_for:
            parts = {"quantities", "events", "times"} & looked_for.keys()
            made = look_of(form, n, start, work_rows=formulas.work_rows, rows=rows, formulas=formulas, **looked_for)
            vars(self).update(vars(made))
        self.counters[TIME], self.counters[ERROR] = t0, 1.0
        kernel, callbacks = variable.kernel(module, form, n, parts=parts), (callback.address, None)
        self.t, self.h = np.empty((2, rows))
        self.u, self.v = np.empty((2, rows, n))
        self.index = self.row = may_shorten = 0
        self.ended = GOING
        while self.ended in (GOING, BEFORE_END):
            may_shorten |= self.ended == BEFORE_END
            span = Span(
                *(t0, t_end, self.p, self.index, 1000, every, self.row, np.inf, rtol, np.zeros((2, n)), 1),
                *(int(may_shorten), 0, 0, np.inf, self.t, self.h, self.u, self.v),
            )
            taken, self.row, self.ended = kernel(callbacks, self.state, Observation(), self.counters, span, self.look)
            self.index += taken


def quantity_rows(run, t, k):
    """Evaluate the quantity k of a run at its saved states."""
    callback, rows = run.callbacks[k], np.full_like(run.saved[k], np.nan)
    scalar = run.u.ndim == 1
    for i in range(len(t)):
        u, v = (float(run.u[i]), float(run.v[i])) if scalar else (run.u[i].copy(), run.v[i].copy())
        if run.follow.table[k, 1]:
            callback.call(t[i], u, v, run.p, rows[i])
        else:
            rows[i] = callback.call(t[i], u, v, run.p)
    return rows


CHAIN = start_of([0.1, 0.2, -0.3], [0.0, 1.0, 0.0])
SPRING = start_of(1.0, 0.2)
CASES = {
    "eig3": (eig3.EIG3(), hardening, SPRING, ((energy, 0, -1), (both, 2, -1))),
    "verlet": (eig3.CentralDifference(velocity="none"), hardening_chain, CHAIN, ((ends, 2, -1), (middle, 0, 1))),
    "newton": (eig3.CentralDifference(solver="newton"), oscillator, SPRING, ((energy, 0, 0),)),
}


@pytest.mark.parametrize("case", CASES)
def test_a_look_changes_no_bit_and_its_values_are_those_of_the_saved_states(case):
    method, rhs, start, quantities = CASES[case]
    plain = FixedRun(method, rhs, start, 0.01, rows=200)
    run = FixedRun(method, rhs, start, 0.01, rows=200, quantities=quantities)
    assert plain.take(200) == run.take(200) == GOING
    np.testing.assert_array_equal(plain.state, run.state)
    np.testing.assert_array_equal(plain.u, run.u)
    np.testing.assert_array_equal(plain.v, run.v)
    np.testing.assert_array_equal(plain.counters[:2], run.counters[:2])
    t = start[0] + 0.01 * np.arange(1, 201)
    table, follow = run.follow.table, run.follow
    for k in range(len(quantities)):
        rows = quantity_rows(run, t, k)
        np.testing.assert_array_equal(run.saved[k], rows)
        columns = slice(table[k, 2], table[k, 2] + rows.shape[1])
        np.testing.assert_array_equal(follow.out[table[k, 3] :][: rows.shape[1]], rows[-1])
        first = look_of(form_of(start[1]), np.size(start[1]), start, work_rows=0, quantities=quantities[k : k + 1])
        states, times = np.vstack([first.follow.extremes[LOW], rows]), np.append(start[0], t)
        ends_of_run = states.min(axis=0), states.max(axis=0)
        expected = *ends_of_run, times[states.argmin(axis=0)], times[states.argmax(axis=0)]
        np.testing.assert_array_equal(follow.extremes[:, columns], expected)
        np.testing.assert_array_equal(follow.steps[:, columns], ends_of_run)
        if quantities[k][2] >= 0:
            speeds = np.append(np.atleast_1d(start[2])[quantities[k][2]], run.v.reshape(200, -1)[:, quantities[k][2]])
            assert follow.most[k] == np.abs(speeds).max()
    cells = np.delete(follow.out, [x for row in table for x in range(row[3], row[3] + max(row[1], 1))])
    assert (cells == 7.5).all()  # the kernel writes nothing between the quantities


def test_parts_of_a_run_end_with_their_steps():
    """A part that ends with step i is followed by one of max(1, i // 5) steps, and the last PARTS of them are kept."""
    run = FixedRun(eig3.EIG3(), hardening, SPRING, 0.05, rows=500, quantities=((energy, 0, -1),))
    run.take(500)
    ends_of_parts = [1]
    while ends_of_parts[-1] <= 500:
        ends_of_parts.append(ends_of_parts[-1] + max(1, ends_of_parts[-1] // 5))
    last = len(ends_of_parts) - 1
    assert (run.counters[PART], run.counters[PART_END]) == (last, ends_of_parts[-1])
    for part in range(last - PARTS + 1, last + 1):
        begin, end = ends_of_parts[part - 1], min(500, ends_of_parts[part])
        values = run.saved[0][begin:end, 0]  # row i is the state after step i + 1
        np.testing.assert_array_equal(run.follow.parts[part % PARTS, :, 0], (values.min(), values.max()))
        if part < last:
            assert run.follow.forward[part % PARTS, 0] == (run.v[end - 1] > 0)


@pytest.mark.parametrize("case", ["eig3", "verlet"])
def test_chunks_follow_the_same(case):
    method, rhs, start, quantities = CASES[case]
    whole, chunked = (FixedRun(method, rhs, start, 0.01, every=3, rows=100, quantities=quantities) for _ in range(2))
    whole.take(300)
    for count in (1, 1, 5, 0, 93, 100, 100):
        chunked.take(count)
    for one, other in zip(whole.follow[1:], chunked.follow[1:], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(whole.counters, chunked.counters)
    np.testing.assert_array_equal(whole.saved[0], chunked.saved[0])


def test_inlined_quantities_are_those_by_address():
    """Only the compiler's choice of fused multiply-adds may differ: some 1e-16 a step, over 200 steps."""
    method, rhs, start, quantities = CASES["verlet"]
    runs = [
        FixedRun(method, rhs, start, 0.01, rows=200, quantities=quantities, inline=inline) for inline in (False, True)
    ]
    for run in runs:
        run.take(200)
    for one, other in zip(runs[0].saved, runs[1].saved, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    for name in ("extremes", "steps", "parts", "forward", "most"):
        one, other = (getattr(run.follow, name) for run in runs)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_nan_becomes_both_extremes_from_its_first_time_on():
    run = FixedRun(eig3.EIG3(), hardening, SPRING, 0.01, rows=300, quantities=((root, 0, -1), (half_written, 2, -1)))
    run.take(300)
    t, is_nan = 0.01 * np.arange(1, 301), np.isnan(run.saved[0][:, 0])
    assert is_nan.any()
    assert not is_nan.all()
    low, high, t_low, t_high = run.follow.extremes[:, 0]
    assert np.isnan([low, high]).all()
    assert t_low == t_high == t[np.argmax(is_nan)]
    assert np.isnan(run.saved[1][:, 1]).all()  # the function does not write this value
    np.testing.assert_array_equal(run.saved[1][:, 0], run.u)


def bouncing(terminal=False, **options):
    """A ball that falls from 1 with g = 8: it hits the floor at t = 0.5 with v = -4, and flies up with v = 2."""
    start = start_of(1.0, 0.0, params=np.array([8.0, 0.5]))
    event = position, None if terminal else bounce, -1, int(terminal)
    return FixedRun(eig3.EIG3(), falling, start, 0.03, events=[event], quantities=((velocity, 0, -1),), **options)


def test_states_at_events_are_followed():
    run = bouncing(rows=25)
    assert run.take(25) == GOING
    # The method and the dense output are exact for a constant acceleration, up to round-off of some units.
    np.testing.assert_allclose(run.follow.extremes[:, 0], [-4.0, 2.0, 0.5, 0.5], rtol=1e-13)
    np.testing.assert_allclose(run.follow.steps[:, 0], [-4.0, 2.0], rtol=1e-13)
    assert run.counters[LOGGED] == 1
    np.testing.assert_array_equal(run.saved[0][:, 0], run.v)
    assert run.v.min() > -4.0  # no end of a step is at the impact
    assert run.v.max() < 2.0


def test_the_values_at_a_terminal_event_are_the_latest():
    run = bouncing(terminal=True, rows=25)
    assert run.take(25) == TERMINAL
    assert run.index == 16
    assert run.counters[ENDED_BY] == 0
    assert run.counters[TIME] == pytest.approx(0.5, rel=1e-13)
    assert run.follow.out[0] == run.state[1] == pytest.approx(-4.0, rel=1e-13)


def test_resets_in_ever_shorter_times_end_the_run():
    """The flights take 1/2, 1/4, ...: they end at 0.5 + 0.5 + 0.25 + ... = 1.5, at one below 2**-43 of this time."""
    run = bouncing(rows=100)
    assert run.take(100) == ZENO
    assert run.counters[TIME] == pytest.approx(1.5, rel=1e-9)
    assert run.follow.out[0] == run.state[1]
    # The flight before impact m takes 0.5**(m - 1): 2**-43 is the first below 1.5 * 2**-43, up to round-off.
    assert run.counters[LOGGED] == pytest.approx(44, abs=1)


def test_a_full_log_ends_a_call_and_the_next_one_goes_on():
    whole, parts = bouncing(rows=100), bouncing(rows=100, log=4)
    whole.take(40)
    parts_log = []
    while parts.index < 40:
        ended = parts.take(40 - parts.index)
        assert ended in (GOING, FULL)
        parts_log.extend(parts.watch.log[: int(parts.counters[LOGGED])].copy())
        parts.counters[LOGGED] = 0
    np.testing.assert_array_equal(parts_log, whole.watch.log[: int(whole.counters[LOGGED])])
    np.testing.assert_array_equal(parts.state, whole.state)
    for name in ("extremes", "steps", "parts"):
        np.testing.assert_array_equal(getattr(parts.follow, name), getattr(whole.follow, name))


def test_quantities_at_wanted_times_widen_nothing():
    """The state is that of the dense output, and the extremes are those of a run without these times."""
    times = np.array([0.004, 0.01, 0.0137, 0.5])
    run, other = (
        FixedRun(eig3.EIG3(), hardening, SPRING, 0.01, 2**62, 4, quantities=((both, 2, -1),), times=wanted)
        for wanted in (times, ())
    )
    for each in (run, other):
        each.take(60)
    assert run.counters[NEXT] == 4
    np.testing.assert_array_equal(run.saved[0][:, 0], run.watch.u_rows[:, 0])
    np.testing.assert_array_equal(run.saved[0][:, 1], times * run.watch.v_rows[:, 0])
    np.testing.assert_array_equal(run.follow.extremes, other.follow.extremes)
    np.testing.assert_array_equal(run.follow.out, other.follow.out)


def test_vectors_are_reset_and_followed():
    """u = -sin(t) in the first degree of freedom, turned at 0: abs(u), of which both extremes are known."""
    start = start_of([-0.5, 0.0, 0.3], [np.sqrt(0.75), 0.0, 0.0])
    event = first_position, turn, 1, 0
    run = FixedRun(eig3.EIG3(), pair, start, 0.01, 1, 300, quantities=((ends, 2, -1),), events=[event])
    plain = FixedRun(eig3.EIG3(), pair, start, 0.01, 1, 300)
    assert run.take(300) == plain.take(300) == GOING
    assert run.counters[LOGGED] == 1
    t_reset = run.watch.log[0, 1]
    assert t_reset == pytest.approx(np.pi / 6, abs=1e-5)  # a period has an error of (omega h)^2 / 24
    steps_before = int(t_reset / 0.01)
    np.testing.assert_array_equal(run.u[:steps_before], plain.u[:steps_before])
    np.testing.assert_array_equal(run.saved[0][:, 0], run.u[:, 0])
    assert abs(run.follow.extremes[HIGH, 0]) < 1e-12  # the state at the event, of which no row is saved
    assert run.follow.extremes[T_HIGH, 0] == t_reset
    assert run.u[:, 0].max() < 0


def test_a_failed_solve_ends_both_kernels():
    method = eig3.CentralDifference(solver="newton", max_iterations=1)
    ended = []
    for looked_for in ({}, {"quantities": ((product, 0, -1),)}):
        run = FixedRun(method, hardening_and_friction, SPRING, 0.5, rows=100, **looked_for)
        ended.append((run.take(100), run.index, run.row, run.state.tolist()))
    assert ended[0] == ended[1]
    assert ended[0][0] == FAILED
    assert ended[0][1] == ended[0][2] < 100


hardening_and_friction = eig3.jit(lambda t, u, v, p: -u - v * np.exp(v * v))


def test_extremes_within_steps_of_variable_length():
    """u = cos(t), and u v = -sin(2 t) / 2: their extremes are known, and steps end elsewhere."""
    quantities = (position, 0, -1), (product, 0, -1)
    run = VariableRun("rk5", harmonic, start_of(1.0, 0.0), 10.0, 1e-6, 1, 400, quantities=quantities)
    plain = VariableRun("rk5", harmonic, start_of(1.0, 0.0), 10.0, 1e-6, 1, 400)
    assert run.ended == plain.ended == AT_END
    rows = run.row
    assert rows == plain.row == run.index
    np.testing.assert_array_equal(run.u[:rows], plain.u[:rows])
    np.testing.assert_array_equal(run.t[:rows], plain.t[:rows])
    extremes, tolerance = run.follow.extremes, 2e-5  # the errors of some tens of steps of rtol add up
    np.testing.assert_allclose(extremes[:2], [[-1.0, -0.5], [1.0, 0.5]], atol=tolerance)
    assert np.cos(extremes[T_LOW, 0]) == pytest.approx(-1, abs=tolerance)
    np.testing.assert_array_equal(run.saved[0][:rows], run.u[:rows])
    np.testing.assert_array_equal(run.follow.steps[:, 0], (run.u[:rows].min(), 1.0))
    assert run.follow.steps[LOW, 0] > extremes[LOW, 0] + 1e-4  # a step is some 0.3, and -1 is between two of its ends
    np.testing.assert_array_equal(run.follow.out[[0, 4]], (run.u[rows - 1, 0], run.u[rows - 1, 0] * run.v[rows - 1, 0]))


def test_variable_steps_save_the_values_before_and_after_a_reset():
    start = start_of(1.0, 0.0, params=np.array([8.0, 0.5]))
    options = {"quantities": ((velocity, 0, -1),), "events": [(position, bounce, -1, 0)]}
    run = VariableRun("rk5", falling, start, 0.9, 1e-6, 1, 100, **options)
    assert run.ended == AT_END
    t, values = run.t[: run.row], run.saved[0][: run.row, 0]
    np.testing.assert_array_equal(values, run.v[: run.row, 0])
    (i,) = np.flatnonzero(np.diff(t) == 0)  # the rows before and after the impact
    np.testing.assert_allclose((t[i], values[i], values[i + 1]), (0.5, -4.0, 2.0), rtol=1e-12)
    np.testing.assert_allclose(run.follow.extremes[:, 0], [-4.0, 2.0, 0.5, 0.5], rtol=1e-12)


def test_vector_form_with_variable_steps():
    quantities = ((ends, 2, 2), (product_of_pair, 0, -1))
    start = start_of([1.0, 0.0, 0.5], np.zeros(3))
    run = VariableRun("rk5", pair, start, 7.0, 1e-8, 3, 400, quantities=quantities)
    assert run.ended == AT_END
    extremes = run.follow.extremes
    # u = cos(t) and v = -sin(2 t) in the two degrees of freedom; errors of some tens of rtol
    np.testing.assert_allclose(extremes[:2, :2], [[-1.0, -1.0], [1.0, 1.0]], atol=1e-6)
    assert run.follow.most[0] == max(abs(run.follow.steps[:, 1]))
    np.testing.assert_array_equal(run.saved[0][: run.row, 0], run.u[: run.row, 0])


product_of_pair = eig3.jit(lambda t, u, v, p: u[0] * u[2])
