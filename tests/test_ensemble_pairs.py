"""Every pair of options of `ensemble`, with fixed steps and with tolerances: each member is what `integrate` gives."""

import itertools
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import eig3

from .conftest import SAME, assert_same, oscillator, position, velocity
from .test_pairs import energy, late, rebound, spring

P = np.array([[3.0, 0.05], [2.0, 0.1], [1.0, 0.0]])
U0 = np.array([1.0, 0.5, -0.25])
SPAN = 0.0, 2.0
WANTED = np.linspace(0.0, 2.0, 9)
STEPS = {"h": {"h": 2.0**-7, "method": "rk4"}, "rtol": {"rtol": 1e-6}}
EVENTS = {
    "events": {"turn": eig3.Event(velocity)},
    "apply": {"wall": eig3.Event(position, -1, apply=rebound)},
    "terminal": {"late": eig3.Event(late, terminal=True)},
}
#: Options that change the run of a member.
OF_RUNS = {
    "save_every": {"save_every": 3},
    "t_eval": {"t_eval": WANTED},
    "outputs": {"outputs": {"force": spring}},
    "invariants": {"invariants": {"energy": energy}},
    "invariants_every": {"invariants_every": 4},
    "h_max": {"h_max": 0.02},
    "first_step": {"first_step": 1e-3},
    "max_steps": {"max_steps": 15},
}
OF_ENSEMBLES = ("check", "threads", "executor", "reduce", "progress", "cancel", "save_to")
AFTERWARDS = ("extend", "save", "tables")
NAMES = (*EVENTS, *OF_RUNS, *OF_ENSEMBLES, *AFTERWARDS)
#: The pairs that make no sense, and the sentence that says so.
REFUSED = {
    frozenset({"save_every", "t_eval"}): "save_every and t_eval exclude each other",
    frozenset({"reduce", "save_to"}): "reduce and save_to exclude each other",
    **{frozenset({"check", x}): f"check and {x} exclude each other" for x in ("executor", "reduce")},
}
OF_TOLERANCES = {"h_max", "first_step", "max_steps"}


def options_of(names):
    events = {}
    for name in names:
        events |= EVENTS.get(name, {})
    options = {"events": events} if events else {}
    for name in names:
        options |= OF_RUNS.get(name, {})
    return options


@pytest.fixture(scope="module")
def executor():
    with ThreadPoolExecutor(2) as pool:
        yield pool


def solve(names, steps, executor, tmp_path, t_end=SPAN[1]):
    given = {
        "check": {"check": True},
        "threads": {"threads": 2},
        "executor": {"executor": executor},
        "reduce": {"reduce": list},
        "progress": {"progress": True},
        "cancel": {"cancel": threading.Event()},
        "save_to": {"save_to": tmp_path / f"to {t_end}"},
    }
    options = options_of(names) | STEPS[steps]
    for name in names:
        options |= given.get(name, {})
    if "t_eval" in options:
        options["t_eval"] = WANTED[t_end >= WANTED]
    return eig3.ensemble(oscillator, (SPAN[0], t_end), U0, 0.0, params=P, **options)


def assert_members(found, names, steps):
    """Each member is the run of `integrate`, but for the round-off of lanes."""
    for i, member in enumerate(found):
        options = {"save_every": None} if "t_eval" not in names else {}
        one = eig3.integrate(oscillator, SPAN, U0[i], 0.0, params=P[i], **options | options_of(names) | STEPS[steps])
        assert (member.status, member.n_steps) == (one.status, one.n_steps)
        # A single run also searches steps in which it then finds no event: g is zero at their end, or changes its sign
        # in the other direction.
        searches = 10 if {"terminal", "apply"} & {*names} and steps == "h" else 0
        assert 0 <= one.n_rhs - member.n_rhs <= searches
        np.testing.assert_allclose(member.t, one.t, rtol=0, atol=1e-14)
        np.testing.assert_allclose(member.u, one.u, rtol=0, atol=1e-12)
        np.testing.assert_allclose(member.v, one.v, rtol=0, atol=1e-12)
        assert {*member.events} == {*one.events}
        for name, occurrences in one.events.items():
            np.testing.assert_allclose(member.events[name].t, occurrences.t, rtol=0, atol=1e-14)
            np.testing.assert_allclose(member.events[name].v_after, occurrences.v_after, rtol=0, atol=1e-12)
        for name, values in one.outputs.items():
            np.testing.assert_allclose(member.outputs[name], values, rtol=0, atol=1e-12)
        for name, drift in one.drift.items():
            assert member.drift[name] == pytest.approx(drift, abs=1e-13)
        for name, extremes in one.extremes.items():
            np.testing.assert_allclose(member.extremes[name], extremes, rtol=0, atol=1e-12)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("names", [*itertools.combinations(NAMES, 2)], ids=" ".join)
def test_a_pair_of_options(names, steps, executor, tmp_path):
    if refusal := REFUSED.get(frozenset(names)):
        with pytest.raises(ValueError, match=refusal):
            solve(names, steps, executor, tmp_path)
        return
    if steps == "h" and OF_TOLERANCES & {*names}:
        with pytest.raises(ValueError, match="exclude each other: give h for a fixed step, or rtol for tolerances"):
            solve(names, steps, executor, tmp_path)
        return
    result = solve(names, steps, executor, tmp_path)
    if "reduce" in names:
        (members,) = result
        assert_members(members, names, steps)
        return
    assert_members(result, names, steps)
    if "check" in names:
        assert [each is not None for each in result.error] == result.success.tolist()
    if "save_to" in names:
        assert_same(eig3.load(tmp_path / f"to {SPAN[1]}"), result, SAME)
    if "save" in names:
        assert_same(eig3.load(result.save(tmp_path / "file")), result, SAME)
    if "extend" in names:
        half = solve([name for name in names if name != "extend"], steps, executor, tmp_path, 1.0)
        further = {"t_eval": WANTED[WANTED > 1.0]} if "t_eval" in names else {}
        assert_same(half.extend(SPAN[1], **further), result, SAME)
    if "tables" in names:
        table = result.to_pandas()
        assert len(table) == sum(len(member.t) for member in result)
        assert table.member.tolist() == [i for i, member in enumerate(result) for _ in member.t]
        assert result.to_xarray().sizes["member"] == len(P)


def test_the_number_of_pairs_stays():
    """A new option of `ensemble` belongs into this file: the signature has these and the arguments of a start.

    An accuracy takes the place of rtol: tests/test_accuracy.py has it.
    """
    import inspect

    taken = {
        "rhs", "t_span", "u0", "v0", "params", "h", "rtol", "atol", "method", "z0", "first_order", "labels",
        "refused"
    }  # fmt: skip
    named = {*OF_RUNS, *OF_ENSEMBLES, "events", "accuracy", "scale", "max_seconds"}
    assert {*inspect.signature(eig3.ensemble).parameters} == taken | named


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"inline": True}, "inline is for single runs: the functions of members are compiled into the loop"),
        ({"raise_on_failure": True}, "raise_on_failure is for single runs: .*look at solution.status"),
        ({"tolerance": 1}, r"ensemble\(\) has no argument 'tolerance'; did you mean rtol"),
    ],
)
def test_what_an_ensemble_does_not_take(option, message):
    with pytest.raises(TypeError, match=message):
        eig3.ensemble(oscillator, SPAN, U0, 0.0, params=P, h=0.1, **option)


softening = eig3.jit(lambda t, u, v, p: -p[0] * u - p[1] * v + p[2] * u * u * u - p[3])
above_wall = eig3.jit(lambda t, u, v, p: u - p[4])
restitution = eig3.jit(lambda t, u, v, p: (u, -p[5] * v))


@pytest.mark.parametrize("method", ["eig3", "ab3", "rk4", "rk5"])
def test_random_members_with_resets_are_single_runs(method):
    """Members that diverge in lanes, where they have no resets; resets without end; rows that end within a step."""
    rng, m, seen = np.random.default_rng(26), 20, set()
    impact = {"impact": eig3.Event(above_wall, -1, apply=restitution)}
    for _ in range(25):
        ranges = (0.5, 20), (0, 0.5), (-3, 0.2), (0, 10), (-0.5, 0.5)
        p = np.column_stack([*(rng.uniform(*each, m) for each in ranges), rng.choice([0.0, 0.5, 0.8, 1.0, 1.1], m)])
        u0, v0, span = rng.uniform(-1, 1, m), rng.uniform(-2, 2, m), (0.0, rng.uniform(0.5, 4))
        steps = {"rtol": 1e-6} if method == "rk5" else {"h": 2.0 ** rng.uniform(-8, -3)}
        options = {"method": method, "events": impact, "save_every": [None, 1, 3][rng.integers(3)], **steps}
        runs, run = eig3.ensemble(softening, span, u0, v0, params=p, **options), eig3.prepare(softening, **options)
        for i, one in enumerate(runs):
            alone = run(span, u0[i], v0[i], p[i])
            seen.add(alone.status)
            assert (one.status, len(one.t)) == (alone.status, len(alone.t))
            for field in "tuv":
                np.testing.assert_allclose(getattr(one, field), getattr(alone, field), rtol=1e-8, atol=1e-8)
            np.testing.assert_allclose(one.events["impact"].t, alone.events["impact"].t, rtol=0, atol=1e-9)
    assert seen >= {eig3.Status.COMPLETED, eig3.Status.ZENO}
