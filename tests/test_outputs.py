"""Outputs: their values at the saved states, and the extremes of outputs and invariants with their times."""

import numpy as np
import pytest

import eig3
from eig3 import integrate, problems
from eig3.ensembles import lanewise

from .conftest import bounce, linear_spring, position

H, END = 0.01, 8.0  # 800 steps, two periods or more
K = 3.0


@eig3.jit
def springs(t, u, v, p, a):
    for j in range(u.size):
        left = u[j - 1] if j > 0 else 0.0
        a[j] = p[0] * (left - 2 * u[j]) - 0.1 * v[j]


force = eig3.jit(lambda t, u, v, p: -p[0] * u + t)
stretch = eig3.jit(lambda t, u, v, p: u[1] - u[0] + 0.1 * v[1] * t)


@eig3.jit
def forces(t, u, v, p, out):
    out[0] = -p[0] * u
    out[1] = v
    out[2] = t


@eig3.jit
def reactions(t, u, v, p, out):
    for j in range(u.size):
        out[j] = -p[0] * u[j]
    out[u.size] = t * v[0]


undefined_later = eig3.jit(lambda t, u, v, p: np.nan if 1.0 < t < 2.0 else u)


@eig3.jit
def first_undefined_later(t, u, v, p, out):
    out[0] = np.nan if 1.0 < t < 2.0 else u
    out[1] = u


@eig3.jit
def unwritten_later(t, u, v, p, out):
    out[0] = u
    if t < 1:
        out[1] = u


@eig3.jit
def raises_later(t, u, v, p):
    if t > 1:
        raise ValueError("too late")
    return u


quarter = eig3.jit(lambda t, u, v, p: u / 4)


def swing(**options):
    return integrate(linear_spring, (0.0, END), 1.0, 0.0, **{"h": H, "params": K, **options})


def swing_two(**options):
    return integrate(springs, (0.0, END), [1.0, -0.5], [0.0, 0.2], **{"h": H, "params": K, **options})


def assert_extremes(extremes, t, values):
    """They are those of the whole history, and so are their times."""
    places = values.argmin(axis=0), values.argmax(axis=0)
    for extreme, place in zip(extremes[:2], places, strict=True):
        np.testing.assert_array_equal(extreme, np.take_along_axis(values, np.array(place)[None, ...], axis=0)[0])
    for time, place in zip(extremes[2:], places, strict=True):
        np.testing.assert_array_equal(time, t[place])


@pytest.mark.parametrize("save_every", [1, 7, 100, 800, None])
def test_values_are_those_of_the_function_at_the_saved_states(save_every):
    run = swing(save_every=save_every, outputs={"force": force, "all": (forces, 3)})
    expected = [force(t, u, v, np.array([K])) for t, u, v in zip(run.t, run.u, run.v, strict=True)]
    np.testing.assert_array_equal(run.outputs["force"], expected)
    np.testing.assert_array_equal(run.outputs["all"], np.stack([-K * run.u, run.v, run.t], axis=1))
    run = swing_two(save_every=save_every, outputs={"reactions": (reactions, 3), "stretch": stretch})
    expected = np.column_stack([-K * run.u, run.t * run.v[:, 0]])
    np.testing.assert_array_equal(run.outputs["reactions"], expected)
    states = zip(run.t, run.u, run.v, strict=True)
    np.testing.assert_array_equal(run.outputs["stretch"], [stretch(*state, np.array([K])) for state in states])


@pytest.mark.parametrize("save_every", [1, 33, None])
@pytest.mark.parametrize("chunk", [1e-12, 1.0])  # seconds of a call of the kernel; a short one has few steps
def test_extremes_are_those_of_every_step(save_every, chunk, monkeypatch):
    monkeypatch.setattr("eig3.run.short.MOST_SECONDS", chunk)
    monkeypatch.setattr("eig3.stepping.slices._SECONDS", chunk)
    functions = {"invariants": {"stretch": stretch}, "outputs": {"also": stretch, "reactions": (reactions, 3)}}
    every, run = swing_two(save_every=1, **functions), swing_two(save_every=save_every, **functions)
    for name, values in every.outputs.items():
        assert_extremes(run.extremes[name], every.t, values)
    assert run.extremes["stretch"] == run.extremes["also"]
    assert run.extremes["reactions"].low.shape == (3,)
    assert type(run.extremes["also"].t_high) is float
    np.testing.assert_array_equal(run.outputs["also"][-1], every.outputs["also"][-1])


at_least = eig3.jit(lambda t, u, v, p: max(u, -0.5))


def test_extremes_of_an_oscillation():
    """u = cos(w t): the first minimum is -1 at pi / w, and it is found at the step nearest to it."""
    extremes = swing(save_every=None, method="rk4", outputs={"u": position}).extremes["u"]
    w = np.sqrt(K)
    assert extremes.t_low == pytest.approx(np.pi / w, abs=H) or extremes.t_low == pytest.approx(3 * np.pi / w, abs=H)
    assert extremes.low == pytest.approx(-1, abs=(w * H) ** 2)  # a step away, the cosine has changed by (w h)^2 / 2
    assert (extremes.high, extremes.t_high) == (1.0, 0.0)
    run = swing(method="rk4", outputs={"at_least": at_least})
    assert_extremes(run.extremes["at_least"], run.t, run.outputs["at_least"])  # of equal values, the first counts


def test_nan_stays_with_the_time_of_the_first():
    run = swing(outputs={"e": undefined_later, "pair": (first_undefined_later, 2)}, invariants={"i": undefined_later})
    first = run.t[run.t > 1][0]
    for name in "ei":
        assert np.isnan(run.extremes[name][:2]).all()
        assert run.extremes[name][2:] == (first, first)
    low, high, t_low, t_high = run.extremes["pair"]
    assert np.isnan([low[0], high[0]]).all()
    assert t_low[0] == t_high[0] == first
    assert (low[1], high[1]) == (run.u.min(), run.u.max())
    np.testing.assert_array_equal(np.isnan(run.outputs["e"]), (run.t > 1) & (run.t < 2))


def test_a_value_that_is_not_written_later_is_nan():
    run = swing(outputs={"pair": (unwritten_later, 2)})
    np.testing.assert_array_equal(np.isnan(run.outputs["pair"][:, 1]), run.t >= 1)
    np.testing.assert_array_equal(run.outputs["pair"][:, 0], run.u)


@pytest.mark.parametrize("save_every", [1, 7, None])
def test_a_run_that_diverges_has_outputs_up_to_its_last_state(save_every):
    run = integrate(position, (0, 3000), 1.0, 0.0, h=1.0, save_every=save_every, outputs={"f": quarter})
    assert run.status is eig3.Status.DIVERGED
    np.testing.assert_array_equal(run.outputs["f"], run.u / 4)
    members = eig3.ensemble(
        position, (0, 3000), [1.0, 0.5], 0.0, h=1.0, save_every=save_every, outputs={"f": quarter, "k": (forces, 3)},
        params=K,
    )  # fmt: skip
    for member in members:
        assert member.status is eig3.Status.DIVERGED
        np.testing.assert_array_equal(member.outputs["f"], member.u / 4)
        np.testing.assert_array_equal(member.outputs["k"][:, 1], member.v)


def test_an_output_that_raises_ends_the_run():
    with pytest.raises(ValueError, match="too late") as caught:
        swing(outputs={"f": raises_later})
    run = caught.value.solution
    assert run.status is eig3.Status.INTERRUPTED
    assert len(run.outputs["f"]) == len(run.t)
    known = ~np.isnan(run.outputs["f"])
    np.testing.assert_array_equal(run.outputs["f"][known], run.u[known])
    assert known[0]
    assert not known[run.t > 1].any()


def ensemble(**options):
    u0 = np.linspace(0.5, 1.5, 40)
    return eig3.ensemble(linear_spring, (0.0, END), u0, 0.0, **{"h": H, "params": K, **options})


def ensemble_of_two(m=40, **options):
    u0 = np.linspace([1.0, -0.5], [0.2, 0.7], m)
    return eig3.ensemble(springs, (0.0, END), u0, [0.0, 0.2], **{"h": H, "params": K, **options})


ROUND_OFF = 1e-11  # lanes may fuse other multiply-adds: some 1e-16 in each of the 800 steps


def assert_same_outputs(member, alone):
    """Times agree exactly: they follow from the step index, and no two steps have nearly the same extremes here."""
    for name, values in alone.outputs.items():
        np.testing.assert_allclose(member.outputs[name], values, rtol=0, atol=ROUND_OFF)
    assert member.extremes.keys() == alone.extremes.keys()
    for name, (low, high, *times) in alone.extremes.items():
        np.testing.assert_allclose(member.extremes[name][:2], (low, high), rtol=0, atol=ROUND_OFF)
        np.testing.assert_array_equal(member.extremes[name][2:], times)


@pytest.mark.parametrize(("save_every", "h"), [(1, H), (7, np.linspace(0.5 * H, H, 40)), (None, H)])
def test_members_have_the_outputs_of_runs_alone(save_every, h):
    scalar = {"save_every": save_every, "outputs": {"force": force, "all": (forces, 3)}}
    vector = {"save_every": save_every, "outputs": {"reactions": (reactions, 3)}, "invariants": {"stretch": stretch}}
    one, two = ensemble(**scalar, h=h), ensemble_of_two(**vector, h=h)
    assert one.notes == two.notes == ()
    assert one.outputs["all"].shape == (*one.u.shape, 3)
    assert one.extremes["all"].t_high.shape == (40, 3)
    for i in (0, 17, 39):
        step = np.broadcast_to(h, 40)[i]
        alone = integrate(linear_spring, (0, END), one.u[i, 0], 0.0, h=step, params=K, **scalar)
        assert_same_outputs(one[i], alone)
        alone = integrate(springs, (0, END), two.u[i, 0], [0.0, 0.2], h=step, params=K, **vector)
        assert_same_outputs(two[i], alone)


def test_members_that_run_alone_have_outputs_too():
    n = lanewise.MOST_DEGREES + 1
    u0 = np.linspace(np.zeros(n), np.ones(n), 3)
    options = {"h": H, "params": K, "save_every": 7, "outputs": {"stretch": stretch, "all": (reactions, n + 1)}}
    members = eig3.ensemble(springs, (0.0, 1.0), u0, np.zeros(n), **options)
    for i in range(3):
        alone = integrate(springs, (0.0, 1.0), u0[i], np.zeros(n), **options)
        for name in options["outputs"]:
            np.testing.assert_array_equal(members[i].outputs[name], alone.outputs[name])
            np.testing.assert_array_equal(members[i].extremes[name], alone.extremes[name])


def test_an_output_that_raises_ends_the_ensemble():
    with pytest.raises(ValueError, match="too late") as caught:
        ensemble(save_every=1, outputs={"f": raises_later})
    solution = caught.value.solution
    assert (solution.status == eig3.Status.INTERRUPTED).all()
    for member in (solution[0], solution[39]):
        np.testing.assert_array_equal(member.outputs["f"], member.u)
        assert member.t[-1] < 1.0 + H
        assert member.extremes["f"].low == member.u.min()


def peaks(part):
    return part.outputs["all"][:, -1].copy(), part.extremes["all"]


def test_outputs_of_parts_are_those_of_the_whole():
    options = {"m": 300, "save_every": 9, "outputs": {"stretch": stretch, "all": (reactions, 3)}}
    whole, parts = ensemble_of_two(**options), ensemble_of_two(**options, reduce=peaks)
    assert len(parts) == 3  # of 128 members at most
    np.testing.assert_array_equal(np.concatenate([values for values, _ in parts]), whole.outputs["all"][:, -1])
    for row, values in enumerate(whole.extremes["all"]):
        np.testing.assert_array_equal(np.concatenate([extremes[row] for _, extremes in parts]), values)


first_position = eig3.jit(lambda t, u, v, p: u[0] + 0.0 * u[u.size - 1])
nine_tenths = eig3.jit(lambda t, u, v, p: t - 0.9)


@pytest.mark.parametrize("steps", [{"h": 0.3}, {"rtol": 1e-6, "method": "rk5"}])
@pytest.mark.parametrize("events", [{}, {"end": eig3.Event(nine_tenths, apply=bounce, terminal=True)}])
def test_values_at_a_wanted_time_that_differs_from_the_end_by_round_off(steps, events):
    """The state there is saved after the last step, before a reset. Three steps of 0.3 end an ulp before 0.9."""
    assert 3 * 0.3 < 0.9
    span, options = (0, 2.1 if events else 0.9), {"t_eval": [0.0, 0.9], "events": events, **steps}
    outputs = {"position": position, "forces": (forces, 3)}
    u0, v0 = np.linspace(1, 2, 70), np.ones(70)  # lanes begin with 64 members
    alone = integrate(linear_spring, span, u0[69], v0[69], params=[K], outputs=outputs, **options)
    members = eig3.ensemble(linear_spring, span, u0, v0, params=[K], outputs=outputs, **options)
    for run in (alone, members[69]):
        assert run.t[-1] == 0.9
        np.testing.assert_array_equal(run.outputs["position"], run.u)
        exact = np.column_stack([-K * run.u, run.v, run.t])
        np.testing.assert_allclose(run.outputs["forces"], exact, rtol=1e-15, atol=0)  # the product is rounded once


def test_a_problem_that_follows_the_work_has_outputs():
    problem = problems.quarter_car(work=True)
    assert problem.z0 == {"work": 0.0}
    options = {"h": 1e-3, "t_end": 0.5, "save_every": 10, "outputs": {"first": first_position}}
    run = problem.integrate(**options)
    np.testing.assert_array_equal(run.outputs["first"], run.u[:, 0])
    assert set(run.extremes) == {"energy", "first"}
    members = problem.ensemble(params=np.array([problem.params] * 3), **options)
    np.testing.assert_array_equal(members[1].outputs["first"], members[1].u[:, 0])
    assert members[1].z.keys() == run.z.keys()


@eig3.jit
def too_many(t, u, v, p, out):
    for j in range(4):
        out[j] = u


@eig3.jit
def too_many_later(t, u, v, p, out):
    for j in range(3 if t < 1 else 4):
        out[j] = u


takes_three = eig3.jit(lambda t, u, v: u)


@eig3.jit
def writes_to_p(t, u, v, p, out):
    p[0] = out[0] = 1.0


@pytest.mark.parametrize("run", [swing, ensemble], ids=["integrate", "ensemble"])
@pytest.mark.parametrize(
    ("outputs", "error", "message"),
    [
        (force, TypeError, "outputs must be a dictionary of names and jitted functions"),
        ({"f": force.py_func}, TypeError, r"outputs\['f'\] must be compiled"),
        ({"f": 3}, TypeError, r"outputs\['f'\] must be a function decorated with"),
        ({"f": takes_three}, TypeError, r"outputs\['f'\] takes 3 arguments, but must take 4"),
        ({"f": forces}, TypeError, r"outputs\['f'\] writes its values: give \(function, k\)"),
        ({"f": (force, 2)}, TypeError, r"outputs\['f'\] takes 4 arguments, but must take 5: \(t, u, v, p, out\)"),
        ({"f": (forces, 0)}, ValueError, "k in outputs.* must be a whole number of at least 1, not 0"),
        ({"f": (forces, 3, 1)}, TypeError, r"outputs\['f'\] must be a function or a pair"),
        ({"f": (forces, 4)}, ValueError, r"outputs\['f'\] does not write out\[3\]"),
        ({"f": (too_many, 3)}, ValueError, r"outputs\['f'\] writes beyond its 3 values; give the right number"),
        ({"f": (too_many_later, 3)}, ValueError, r"outputs\['f'\] writes beyond its 3 values"),
        ({"f": (writes_to_p, 1)}, TypeError, r"outputs\['f'\] must not write to u, v or p"),
        ({"e": force}, ValueError, "'e' is the name of an invariant and of an output; give them different names"),
    ],
)
def test_errors(run, outputs, error, message):
    with pytest.raises(error, match=message) as caught:
        run(outputs=outputs, invariants={"e": force})
    assert "\n" not in str(caught.value)
