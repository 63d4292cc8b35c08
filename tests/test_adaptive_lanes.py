"""Members with tolerances in lanes: each takes the steps of its single run, whatever runs beside it."""

import numba
import numpy as np
import pytest

import eig3
from eig3.ensembles import adaptive_observer, lanewise
from eig3.kernels.loops import observe
from eig3.kernels.protocol import LOOK_WITHIN, SCALAR
from eig3.stepping import slices as slices_of_steps

from .conftest import above_level, assert_same, falling, linear_spring, position, rebound

RNG = np.random.default_rng(2)
M = 150  # which is more than two blocks have lanes

duffing = eig3.jit(lambda t, u, v, p: p[0] * eig3.math.cos(t) - 0.1 * v - u - p[1] * u * u * u)
van_der_pol = eig3.jit(lambda t, u, v, p: p[0] * (1.0 - u * u) * v - u)


@eig3.jit
def planet(t, u, v, p, a):
    r2 = u[0] * u[0] + u[1] * u[1]
    per_cube = p[0] / (r2 * np.sqrt(r2))
    a[0] = -u[0] * per_cube
    a[1] = -u[1] * per_cube


cubic = eig3.jit(lambda t, u, v, p: p[0] * u * u * u)


def ellipses(m):
    e = np.linspace(0.0, 0.9, m)
    zero = np.zeros(m)
    u, v = np.column_stack([1 - e, zero]), np.column_stack([zero, np.sqrt((1 + e) / (1 - e))])
    return planet, (0.0, 15.0), u, v, np.ones((m, 1))


CASES = {
    "duffing": (
        duffing,
        (0.0, 30.0),
        RNG.uniform(0.5, 2, M),
        RNG.uniform(-0.5, 0.5, M),
        np.column_stack([RNG.uniform(0, 0.5, M), RNG.uniform(0.5, 2, M)]),
    ),
    "from rest": (duffing, (0.0, 10.0), 0.0, 0.0, np.column_stack([np.linspace(0.1, 1, M), np.ones(M)])),
    "van der pol": (van_der_pol, (0.0, 20.0), 2.0, 0.0, np.linspace(1, 20, M)[:, None]),
    "planet": ellipses(M),
}


def solve(case, chosen=slice(None), run=eig3.ensemble, **options):
    rhs, span, u, v, p = CASES[case]
    u, v = (x[chosen] if np.ndim(x) else x for x in (u, v))
    method = "rk8" if case == "planet" else "rk5"
    return run(rhs, span, u, v, params=p[chosen], **{"rtol": 1e-6, "method": method, **options})


def single(case, i, **options):
    return solve(case, i, eig3.integrate, save_every=None, **options)


@pytest.fixture
def in_lanes(monkeypatch):
    """Let no member run alone."""

    def alone(*arguments):
        raise AssertionError("a member ran alone")

    monkeypatch.setattr("eig3.ensembles.single_members.Singles.__call__", alone)


@pytest.mark.parametrize("case", CASES)
def test_members_take_the_steps_of_single_runs(case, in_lanes):
    """The same steps, but for round-off, which the motions of this length make a thousand times larger at most."""
    found = solve(case)
    assert not found.notes
    for i in range(0, M, 7):
        one = single(case, i)
        assert (found.status[i], found.message[i]) == (one.status, one.message)
        assert (found.n_steps[i], found.n_rhs[i], found.n_rejected[i]) == (one.n_steps, one.n_rhs, one.n_rejected)
        assert found.h[i] == pytest.approx(one.h, rel=1e-14)
        assert found[i].t[-1] == one.t[-1]
        np.testing.assert_allclose(found[i].u[-1], one.u[-1], rtol=0, atol=1e-11)
        np.testing.assert_allclose(found[i].v[-1], one.v[-1], rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    "options",
    [{"atol": 1e-9}, {"atol": [[1e-8], [1e-7]]}, {"h_max": 0.05}, {"first_step": 1e-4}, {"rtol": 1e-3}],
    ids=str,
)
def test_options_of_the_tolerances(options, in_lanes):
    found = solve("duffing", **options)
    for i in range(0, M, 30):
        one = single("duffing", i, **options)
        assert (found.n_steps[i], found.n_rhs[i]) == (one.n_steps, one.n_rhs)
        np.testing.assert_allclose(found[i].u[-1], one.u[-1], rtol=0, atol=1e-11)


def test_a_force_of_the_position_takes_rkn12(in_lanes):
    stiffness = np.linspace(1, 4, 70)[:, None]
    found = eig3.ensemble(linear_spring, (0, 20), 1.0, 0.0, rtol=1e-9, params=stiffness, t_eval=[20.0])
    assert found.method == eig3.RKN12()
    exact = np.cos(20 * np.sqrt(stiffness[:, 0]))
    np.testing.assert_allclose(found.u[:, -1], exact, rtol=0, atol=1e-8)  # rtol times some ten steps


@pytest.mark.parametrize("case", ["duffing", "from rest", "planet"])
def test_a_member_depends_on_nothing_but_itself(case):
    """The same bits for another order, in parts, in threads, and for a member that shares the lanes with copies.

    Of 130 members, a part of 128 leaves 2.
    """
    found, order = solve(case, threads=1), RNG.permutation(M)
    (part,) = solve(case, slice(130), reduce=lambda part: part)
    np.testing.assert_array_equal(part.u, found.u[:130])
    for other, chosen in (
        (solve(case, order), order),
        (solve(case, slice(20, 60)), slice(20, 60)),
        (solve(case, threads=3), slice(None)),
        (solve(case, np.full(20, 7)), np.full(20, 7)),
    ):
        np.testing.assert_array_equal(other.u, found.u[chosen])
        np.testing.assert_array_equal(other.v, found.v[chosen])
        np.testing.assert_array_equal(other.n_rhs, found.n_rhs[chosen])


def test_no_lane_waits(monkeypatch):
    """One member has a hundred times the work of the others. The block takes its steps, and those that the others fill.

    The last members may begin when the others end, which costs the steps of one more.
    """
    calls, kernel = [], lanewise.adaptive_kernel("rk5", SCALAR, 1, lanewise.ADAPTIVE_LANES, 0)
    monkeypatch.setattr(slices_of_steps, "_SECONDS", 0.0)  # each call of the kernel is a step
    monkeypatch.setattr(slices_of_steps, "_LONGEST", 0.0)
    monkeypatch.setattr(lanewise, "adaptive_kernel", lambda *_: lambda *given: calls.append(1) or kernel(*given))
    stiff = np.ones((300, 1))
    stiff[5] = 1e4
    found = eig3.ensemble(linear_spring, (0, 20), 1.0, 0.0, rtol=1e-6, method="rk5", params=stiff, threads=1)
    trials = found.n_steps + found.n_rejected
    assert trials[5] > 50 * trials[0]
    assert trials[5] <= len(calls) <= trials[5] + trials[0] + 2
    rounds = -(-299 // (lanewise.ADAPTIVE_LANES - 1))
    calls.clear()
    eig3.ensemble(linear_spring, (0, 20), 1.0, 0.0, rtol=1e-6, method="rk5", params=np.ones((299, 1)), threads=1)
    assert len(calls) <= (rounds + 1) * (trials[0] + 1)


def test_what_lanes_leave_is_what_a_single_run_says():
    """u'' = p u^3 is singular at a finite time for p > 0; those members end as single runs do."""
    p = np.linspace(-2, 2, 40)[:, None]
    for options in ({}, {"events": {"slow": eig3.Event(slow)}}, {"save_every": 2}, {"max_steps": 20}):
        found = eig3.ensemble(cubic, (0, 4), 1.0, 0.0, rtol=1e-6, method="rk5", params=p, **options)
        for i in range(0, 40, 3):
            given = {"rtol": 1e-6, "method": "rk5", "save_every": None, **options}
            one = eig3.integrate(cubic, (0, 4), 1.0, 0.0, params=p[i], **given)
            assert len(found[i].t) == len(one.t)
            assert (found.status[i], found.message[i]) == (one.status, one.message)
            np.testing.assert_allclose(found[i].u[-1], one.u[-1], rtol=1e-9)
            assert {name: len(each) for name, each in found[i].events.items()} == {
                name: len(each) for name, each in one.events.items()
            }  # none twice, in lanes and alone
    assert {status.name for status in found.status} == {"COMPLETED", "TOO_MANY_STEPS"}


brake = eig3.jit(lambda t, u, v, p: (u, 0.8 * v))
slow = eig3.jit(lambda t, u, v, p: v - 0.1)
clock = eig3.jit(lambda t, u, v, p: t - 2.5)
far_side = eig3.jit(lambda t, u, v, p: u[0] + 0.5)


@eig3.jit
def push(t, u, v, p):
    v[1] *= 1.01


THERE = {"there": eig3.Event(above_level, direction=-1)}
SIGHTS = {
    "logged": {"events": {**THERE, "slow": eig3.Event(slow)}},
    "one function": {"events": {"rises": eig3.Event(above_level, direction=1), **THERE, "slow": eig3.Event(slow)}},
    "reset": {"events": {"there": eig3.Event(above_level, apply=brake)}},
    "terminal": {"events": {"there": eig3.Event(above_level, direction=-1, terminal=True)}},
    "terminal reset": {
        "events": {"there": eig3.Event(above_level, apply=brake, terminal=True), "slow": eig3.Event(slow)}
    },
    "times": {"t_eval": np.linspace(0.0, 10.0, 23)},
    "late times": {"t_eval": [3.3, 3.4, 10.0]},
    "times and resets": {
        "t_eval": np.linspace(0.0, 10.0, 23),
        "events": {"there": eig3.Event(above_level, apply=brake)},
    },
    "times at an end": {
        "t_eval": np.linspace(0.0, 10.0, 21),
        "events": {"clock": eig3.Event(clock, terminal=True), "slow": eig3.Event(slow)},
    },
    "times and an end": {
        "t_eval": np.linspace(0.0, 10.0, 203),
        "events": {"there": eig3.Event(above_level, direction=-1, terminal=True)},
    },
}
PLACES = np.column_stack([np.linspace(1.0, 2.0, M), np.linspace(-1.5, 1.5, M)])  # of a spring with u from 1 to -1


def assert_as_single(found, one, i, atol=1e-10):
    """The same steps and the same events, but for the round-off of some ten steps."""
    assert (found.status[i], found.message[i][:40]) == (one.status, one.message[:40])
    assert (found.n_steps[i], found.n_rhs[i], found.n_rejected[i]) == (one.n_steps, one.n_rhs, one.n_rejected)
    assert found.h[i] == pytest.approx(one.h, rel=1e-11)
    mine = found[i]
    if len(one.t) != 2:  # lanes do not know the step to the end
        np.testing.assert_allclose(mine.steps, one.steps, rtol=1e-4)  # of errors, in which round-off is larger
    for name in ("t", "u", "v"):
        np.testing.assert_allclose(getattr(mine, name), getattr(one, name), rtol=0, atol=atol)
    for name, expected in one.events.items():
        occurrences = mine.events[name]
        assert len(occurrences) == len(expected)
        for column in ("t", "u", "v", "u_after", "v_after"):
            np.testing.assert_allclose(getattr(occurrences, column), getattr(expected, column), rtol=0, atol=1e-10)
        first = expected.t[0] if len(expected) else np.nan
        np.testing.assert_allclose(found.events[name].first[i], first, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("method", "sight"),  # the next test has rk8
    [("rk5", sight) for sight in SIGHTS]
    + [(method, sight) for method in ("eig3", "rkn12") for sight in ("logged", "times and resets", "times at an end")],
)
def test_events_and_times_are_those_of_single_runs(method, sight, in_lanes):
    options = {"rtol": 1e-5 if method == "eig3" else 1e-8, "method": method, **SIGHTS[sight]}
    found = eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, params=PLACES, **options)
    assert not found.notes
    for i in range(0, M, 11):
        with_ends = options if "t_eval" in options else {**options, "save_every": None}
        one = eig3.integrate(linear_spring, (0, 10), 1.0, 0.3, params=PLACES[i], **with_ends)
        assert_as_single(found, one, i)


def test_events_of_two_degrees_of_freedom(in_lanes):
    rhs, span, u, v, p = CASES["planet"]
    options = {"rtol": 1e-7, "method": "rk8", "t_eval": [0.0, 5.0, 15.0]}
    options["events"] = {"far": eig3.Event(far_side, apply=push)}
    found = eig3.ensemble(rhs, span, u, v, params=p, **options)
    assert len(found.events["far"]) > 3 * M
    for i in range(0, M // 2, 7):  # up to e = 0.45: a close passage makes round-off larger
        assert_as_single(found, eig3.integrate(rhs, span, u[i], v[i], params=p[i], **options), i)


def test_members_with_events_depend_on_nothing_but_themselves(monkeypatch):
    """The same bits in another order, in threads, and with a log that is full at nearly every step."""
    options = {"rtol": 1e-7, "method": "rk5", "t_eval": np.linspace(0, 10, 9)}
    options["events"] = {"there": eig3.Event(above_level, apply=brake), "slow": eig3.Event(slow)}
    order = RNG.permutation(M)
    found = eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, params=PLACES, threads=1, **options)
    others = [(eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, params=PLACES[order], threads=2, **options), order)]
    monkeypatch.setattr("eig3.stepping.observer._LOG_ROWS", 1)
    monkeypatch.setattr("eig3.stepping.observer._LOG_VALUES", 1)
    others.append((eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, params=PLACES, threads=1, **options), np.arange(M)))
    for other, chosen in others:
        for name in ("u", "v", "steps", "n_rhs"):
            np.testing.assert_array_equal(getattr(other, name), getattr(found, name)[chosen])
        for name in ("there", "slow"):
            np.testing.assert_array_equal(other.events[name].first, found.events[name].first[chosen])
            for i in range(0, M, 17):
                np.testing.assert_array_equal(other[i].events[name].t, found[int(chosen[i])].events[name].t)


def test_balls_that_come_to_rest_end_as_single_runs_do():
    """Their impacts follow each other without end: a single run takes them, whose occurrences are not written twice."""
    options = {"rtol": 1e-6, "method": "rk5", "events": {"impact": eig3.Event(position, direction=-1, apply=rebound)}}
    heights = np.linspace(0.5, 5.0, 40)  # of which the higher ones still bounce at the end
    found = eig3.ensemble(falling, (0, 2), heights, 0.0, params=np.full((40, 1), 9.81), **options)
    assert {status.name for status in found.status} == {"COMPLETED", "ZENO"}
    for i in range(0, 40, 3):
        one = eig3.integrate(falling, (0, 2), heights[i], 0.0, params=[9.81], save_every=None, **options)
        assert_as_single(found, one, i)


def test_functions_that_do_not_compile_in_lanes_run_one_at_a_time():
    @eig3.jit
    def copied(t, u, v, p, a):
        w = u.copy()
        a[0], a[1] = -p[0] * w[0], -p[0] * w[1]

    options = {"rtol": 1e-5, "method": "rk8", "params": np.ones((20, 1))}
    found = eig3.ensemble(copied, (0, 1), np.ones(2), np.zeros(2), **options)
    assert found.success.all()
    assert "a function does not compile for lanes" in found.notes[0]
    np.testing.assert_allclose(found.u[:, -1], np.cos(1), rtol=1e-5)


def test_few_members_run_alone(monkeypatch):
    def kernel(*arguments):
        raise AssertionError("few members ran in lanes")

    monkeypatch.setattr(lanewise, "adaptive_kernel", kernel)
    found = solve("duffing", slice(15))
    for i in range(15):  # with the bits of single runs
        alone = single("duffing", i)
        assert (found.u[i, -1], found.v[i, -1]) == (alone.u[-1], alone.v[-1])


strain = eig3.jit(lambda t, u, v, p: 0.5 * v * v + 0.5 * p[0] * u * u)


@eig3.jit
def forces(t, u, v, p, out):
    out[0] = -p[0] * u
    out[1] = u * v


power = eig3.jit(lambda t, u, v, p: u * v)

OBSERVED = {
    "saved": {"save_every": 3},
    "all saved": {"save_every": 1},
    "energy": {"invariants": {"energy": strain}},
    "sometimes": {"invariants": {"energy": strain}, "invariants_every": 5},
    "outputs": {"outputs": {"power": power, "forces": (forces, 2)}},
    "saved outputs": {"outputs": {"forces": (forces, 2)}, "save_every": 2},
    "all": {
        "outputs": {"power": power, "forces": (forces, 2)},
        "invariants": {"energy": strain},
        "events": {"there": eig3.Event(above_level, apply=brake), "slow": eig3.Event(slow)},
        "save_every": 1,
    },
    "all at times": {
        "outputs": {"power": power, "forces": (forces, 2)},
        "invariants": {"energy": strain},
        "events": {"there": eig3.Event(above_level, apply=brake)},
        "t_eval": np.linspace(0.0, 10.0, 23),
    },
    "saved and logged": {"save_every": 4, "events": {"slow": eig3.Event(slow)}},
    "an end": {
        "outputs": {"power": power},
        "events": {"there": eig3.Event(above_level, direction=-1, terminal=True)},
        "save_every": 4,
    },
}


@pytest.mark.parametrize(
    ("method", "observed"),
    [("rk5", observed) for observed in OBSERVED] + [("rkn12", observed) for observed in ("saved", "all at times")],
)
def test_quantities_and_saved_states_are_those_of_single_runs(method, observed, in_lanes):
    options = {"rtol": 1e-8, "method": method, **OBSERVED[observed]}
    found = eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, params=PLACES, **options)
    assert not found.notes
    for i in range(0, M, 11):
        ends = {} if "t_eval" in options else {"save_every": None}
        one = eig3.integrate(linear_spring, (0, 10), 1.0, 0.3, params=PLACES[i], **{**ends, **options})
        # The step follows from errors, in which round-off is larger, and saved states are at the ends of steps.
        atol = 1e-5 if "save_every" in options else 1e-9
        assert_as_single(found, one, i, atol)
        mine = found[i]
        if "events" not in options:
            w = np.sqrt(PLACES[i, 0])
            exact = np.cos(w * mine.t) + 0.3 / w * np.sin(w * mine.t)
            np.testing.assert_allclose(mine.u, exact, rtol=0, atol=1e-6)  # rtol times some ten steps
        assert (mine.n_invariants, list(mine.drift)) == (one.n_invariants, list(one.drift))
        for name, values in one.outputs.items():
            np.testing.assert_allclose(mine.outputs[name], values, rtol=0, atol=10 * atol)
        for name, drift in one.drift.items():
            assert mine.drift[name] == pytest.approx(drift, rel=1e-3, abs=1e-14)  # a difference near round-off
        for name, extremes in one.extremes.items():
            np.testing.assert_allclose(mine.extremes[name], extremes, rtol=0, atol=1e-6)  # also of times


def test_a_quantity_that_writes_beyond_its_values_is_refused():
    @eig3.jit
    def three(t, u, v, p, out):
        out[0] = out[1] = u
        if t > 5:
            out[2] = u

    with pytest.raises(ValueError, match="writes beyond"):
        eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, params=PLACES, rtol=1e-6, outputs={"o": (three, 2)})


def test_saved_states_of_many_steps_depend_on_no_room(monkeypatch):
    """The same bits with room for the states of four steps, and in parts of an executor."""
    options = {"params": PLACES, "rtol": 1e-7, "method": "rk5", "save_every": 1, "outputs": {"power": power}}
    found = eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, **options)
    monkeypatch.setattr("eig3.ensembles.adaptive_observer._ROWS", 1)
    other = eig3.ensemble(linear_spring, (0, 10), 1.0, 0.3, threads=1, **options)
    assert len(set(np.isfinite(found.t).sum(axis=1))) > 10
    assert_same(other, found)


def test_kernels_get_arrays_of_their_types(monkeypatch):
    """Calls do not check them: an array with an axis more than its type has would be written beyond its record."""
    place, looks = observe.placing(), []
    monkeypatch.setattr(adaptive_observer, "placing", lambda: lambda *given: looks.append(given[0]) or place(*given))
    times = np.linspace(0, 3, 5)
    eig3.ensemble(linear_spring, (0, 3), np.ones(70), 0.0, params=[3.0], rtol=1e-6, t_eval=times)
    assert {numba.typeof(look) for look in looks} == {LOOK_WITHIN}
