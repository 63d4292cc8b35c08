"""Pairs of options of `integrate`, with a fixed step and with tolerances: each gives what it gives alone."""

import itertools

import numpy as np
import pytest

import eig3

from .conftest import assert_same, oscillator, position, rebound, spring, velocity
from .test_prepare import energy

P = np.array([3.0, 0.05])
SPAN = 0.0, 2.0
WANTED = np.linspace(0.0, 2.0, 9)
STEPS = {"h": {"h": 2.0**-7, "method": "ab3"}, "rtol": {"rtol": 1e-6, "method": "rk5"}}

late = eig3.jit(lambda t, u, v, p: t - 1.75)

#: The events by the option that asks for them: one that only looks, one that resets the state, one that ends the run.
EVENTS = {"events": eig3.Event(velocity), "apply": eig3.Event(position, -1, apply=rebound)}
EVENTS["terminal"] = eig3.Event(late, terminal=True)
OPTIONS = {
    "save_every": {"save_every": 3},
    "t_eval": {"t_eval": WANTED},
    "outputs": {"outputs": {"force": spring}},
    "invariants": {"invariants": {"energy": energy}},
    "invariants_every": {"invariants_every": 4},
    "inline": {"inline": True},
    "progress": {"progress": True},
}
AFTERWARDS = ("save_to", "extend", "save", "at", "tables")
NAMES = (*EVENTS, *OPTIONS, *AFTERWARDS)
WITH_INLINE = {"inline", "progress", *AFTERWARDS}
PAIRS = [
    pair
    for pair in itertools.combinations(NAMES, 2)
    if set(pair) != {"save_every", "t_eval"} and ("inline" not in pair or WITH_INLINE.issuperset(pair))
]
# Each set of quantities is another loop to compile with inline: these have one.
PAIRS += [("events", "apply", "save_every", "outputs", "invariants", "invariants_every", "inline")]
PAIRS += [("terminal", "t_eval", "outputs", "invariants", "inline")]


def integrate(names, steps, t_end=SPAN[1], **further):
    options = {}
    for name in names:
        options |= OPTIONS.get(name, {})
    if "t_eval" in options:
        options["t_eval"] = WANTED[t_end >= WANTED]
    events = {name: event for name, event in EVENTS.items() if name in names}
    return eig3.integrate(
        oscillator, (SPAN[0], t_end), 1.0, 0.0, params=P, events=events or None, **STEPS[steps], **options, **further
    )


def whole(names, steps):
    """The run with the same motion in which everything is followed, and every step saved."""
    kept = [name for name in names if name in ("apply", "terminal", "t_eval", "invariants_every")]
    return integrate([*kept, "events", "outputs", "invariants"], steps)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("names", PAIRS, ids=" ".join)
def test_a_pair_of_options(names, steps, tmp_path):
    expected = whole(names, steps)
    run = integrate(names, steps, **({"save_to": tmp_path / "run"} if "save_to" in names else {}))
    assert run.status is (eig3.Status.TERMINATED if "terminal" in names else eig3.Status.COMPLETED)
    assert run.n_steps == expected.n_steps
    # Inlined loops with other quantities may be rounded in another way, and step control makes more of round-off.
    tolerance = 0.0 if "inline" not in names else 1e-12 if steps == "h" else 1e-10
    rows = np.flatnonzero((np.abs(expected.t[:, None] - run.t) <= tolerance).any(axis=1))
    # Of two rows with one time, before and after a reset, a run that saves fewer states has one.
    if len(rows) == len(run.t):
        np.testing.assert_allclose(run.u, expected.u[rows], rtol=0, atol=tolerance)
        np.testing.assert_allclose(run.v, expected.v[rows], rtol=0, atol=10 * tolerance)
    else:
        assert "apply" in names
    assert (run.u[0], run.v[0]) == (1.0, 0.0)
    for name, drift in run.drift.items():
        assert drift == pytest.approx(expected.drift[name], rel=1e-9)
        assert run.extremes[name] == pytest.approx(expected.extremes[name], rel=1e-9)
    for values in run.outputs.values():
        np.testing.assert_allclose(values, -P[0] * P[0] * run.u, rtol=1e-15)
    for name, found in run.events.items():
        np.testing.assert_allclose(found.t, expected.events[name].t, rtol=1e-12)
        assert len(found.t) > 0
    check_afterwards(run, names, steps, tmp_path)


def check_afterwards(run, names, steps, tmp_path):
    """Check what can be done with a run that has ended."""
    if "save_to" in names:
        assert_same(eig3.load(tmp_path / "run"), run)
    if "save" in names:
        assert_same(eig3.load(run.save(tmp_path / "file")), run)
    if "extend" in names and "terminal" not in names:
        half = integrate(names, steps, 1.0)
        further = {"t_eval": WANTED[WANTED > 1.0]} if "t_eval" in names else {}
        assert_same(half.extend(SPAN[1], **further), run)
    if "at" in names:
        t = np.array([0.1, 0.77, 1.6])
        fine = integrate([name for name in names if name in ("apply", "terminal")], "h")
        if "save_every" not in names and "t_eval" not in names:
            np.testing.assert_allclose(run.at(t)[0], fine.at(t)[0], atol=2e-5)  # the errors of both runs
    if "tables" in names:
        assert len(run.to_pandas()) == len(run.t)
        assert dict(run.to_xarray().sizes)["t"] == len(run.t)
