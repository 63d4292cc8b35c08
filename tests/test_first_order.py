"""Systems u'' = f(t, u, v, z), z' = g(t, u, v, z) with first-order unknowns z."""

import copy
import pickle
import re

import numpy as np
import pytest
from scipy.linalg import expm

import eig3
from eig3.methods import METHODS

from .conftest import assert_same, first_position
from .test_resume import After

P = np.array([4.0, 1.5, 0.7])  # stiffnesses per mass, and the relaxation time
START = np.array([1.0, 0.3, 0.2])  # u, v and z
END = 3.0
REFUSED = {"rkn12", "bm6", "langevin"}
UNSTABLE = {"eig9", "eig10", "eig11", "eig12", "eig13"}  # at steps with which their errors are far above round-off
ALIKE = {"eig4", "eig7"}  # one text makes the kernels of all grades


@eig3.jit
def solid(t, u, v, z, p, a, dz):
    """A mass on a spring, beside a spring and a damper in series: z is the stretch of the second spring."""
    a[0] = -p[0] * u[0] - p[1] * z[0]
    dz[0] = v[0] - z[0] / p[2]


@eig3.jit
def solid_with_names(t, u, v, z, p, a, dz):
    a[0] = -p.k * u[0] - p.k1 * z[0]
    dz[0] = v[0] - z[0] / p.tau


@eig3.jit
def forced(t, u, v, z, p, a, dz):
    """Two masses with a hysteretic link, a gyroscopic force and a driven first-order filter."""
    a[0] = -4 * u[0] - z[0] + 0.5 * v[1]
    a[1] = -9 * u[1] + z[0] - 0.5 * v[0] + z[1]
    rate = v[0] - v[1]
    dz[0] = 5 * rate * (1 - z[0] ** 2)
    dz[1] = np.sin(2 * t) * u[0] - z[1]


@eig3.jit
def force(t, u, v, z, p, out):
    out[0], out[1] = p[0] * u[0], p[1] * z[0]


stretch = eig3.jit(lambda t, u, v, z, p: z[0])


def exact(t, p=P, start=START):
    """Return u, v and z of `solid`."""
    k, k1, tau = p
    return expm(np.array([[0, 1, 0], [-k, 0, -k1], [0, 1, -1 / tau]]) * t) @ start


IDLE = {"stretch": START[2], "idle": 1e6}


def run(rhs=solid, span=(0, END), start=START, params=P, z0=None, **options):
    return eig3.integrate(rhs, span, start[:1], start[1:2], z0=z0 or start[2], params=params, **options)


def last(solution):
    return np.concatenate([solution.u[-1], solution.v[-1], np.hstack([x[-1] for x in solution.z.values()])])


@pytest.mark.parametrize("method", [name for name in METHODS if name not in REFUSED | UNSTABLE | ALIKE])
def test_u_v_and_z_have_the_order_of_the_method(method):
    """Richardson's ratios of errors, in a linear problem with a known solution.

    The steps are so long that round-off, about 1e-14, is below a thousandth of the smaller error; a longer step of a
    high order may not be in the asymptotic range, so 0.35 below the order is allowed. The kernels of three unknowns are
    those of many tests: with two, each takes time to compile.
    """
    order = eig3.METHODS[method]().order
    n = {1: 100, 2: 200, 3: 150, 4: 60, 5: 50, 6: 40, 7: 36, 8: 24, 9: 26, 10: 28, 11: 30}[order]
    ends = [last(run(solid_and_an_idle_unknown, h=END / steps, method=method, z0=IDLE)) for steps in (n, 2 * n)]
    errors = [np.abs(end[:3] - exact(END)).max() for end in ends]
    assert np.log2(errors[0] / errors[1]) > order - 0.35


@pytest.mark.parametrize("method", ["eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3", "eig5", "rk5"])
def test_orders_with_a_force_memory_and_a_gyroscopic_force(method):
    """Here the order could drop: z and v are in products, and in forces across the velocity."""
    start = [0.5, -0.2], [0.3, 0.8]

    def at_end(h, method):
        solution = eig3.integrate(forced, (0, 4), *start, z0={"link": 0.1, "filter": 0.0}, h=h, method=method)
        return np.concatenate([solution.u[-1], solution.v[-1], [solution.z[name][-1] for name in ("link", "filter")]])

    order = eig3.METHODS[method]().order
    true, h = at_end(1e-3, "rk8"), 4 / (200 if order < 5 else 160)
    errors = [np.abs(at_end(step, method) - true) for step in (h, h / 2)]
    assert (np.log2(errors[0].max() / errors[1].max()) > order - 0.3).all()


@pytest.mark.parametrize("method", ["rk5", "rk8"])
def test_tolerances_bound_u_v_and_z(method):
    """The error of the run is some times the tolerance: 20 allows for the sum over the steps."""
    for rtol in (1e-4, 1e-7, 1e-10):
        assert np.abs(last(run(rtol=rtol, method=method)) - exact(END)).max() < 20 * rtol


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_unit_of_z_does_not_change_the_steps(scale):
    """The size of z for its tolerance is its own."""

    def scaled(scale):
        p = [4.0, 1.5 / scale, 0.7, scale]
        return eig3.integrate(in_a_unit, (0, 20), [1.0], [0.3], z0=0.2 * scale, params=p, rtol=1e-7, method="rk5")

    one, other = scaled(1.0), scaled(scale)
    assert abs(one.n_steps - other.n_steps) <= 0.05 * one.n_steps  # sizes have a bound by the velocities
    np.testing.assert_allclose(other.z["z"][-1] / scale, one.z["z"][-1], rtol=0, atol=1e-6)


@eig3.jit
def in_a_unit(t, u, v, z, p, a, dz):
    a[0] = -p[0] * u[0] - p[1] * z[0]
    dz[0] = p[3] * v[0] - z[0] / p[2]


@eig3.jit
def solid_and_an_idle_unknown(t, u, v, z, p, a, dz):
    a[0] = -p[0] * u[0] - p[1] * z[0]
    dz[0], dz[1] = v[0] - z[0] / p[2], 0.0


@pytest.mark.parametrize("method", ["rk5", "rk8"])
def test_a_large_constant_unknown_changes_no_step(method):
    """Neither it nor its integral is a size of the motion, and its error is 0."""
    one = run(rtol=1e-6, method=method)
    other = run(solid_and_an_idle_unknown, rtol=1e-6, method=method, z0=IDLE)
    # The first step comes from a mean over all unknowns.
    assert abs(other.n_steps - one.n_steps) <= 1
    np.testing.assert_allclose(other.u[-1], one.u[-1], rtol=0, atol=1e-5)


def test_atol_of_z():
    """A row for u, which z does not use, and a row for v; or one number for all."""
    of_all = run(rtol=1e-6, atol=1e-9, method="rk5")
    loose = run(rtol=1e-6, atol=[[1e-9, 1.0], [1e-9, 1e-2]], method="rk5")
    assert loose.n_steps < of_all.n_steps
    with pytest.raises(ValueError, match=re.escape("an array of shape (2, 2) with a row for u")):
        run(rtol=1e-6, atol=[1e-9] * 3)


def test_the_first_states_of_a_run_are_interpolated_as_the_whole():
    solution = eig3.integrate(solid, (0, 1), START[:1], START[1:2], z0=START[2], params=P, h=0.01)
    t = np.linspace(0.0, 0.2, 30)
    for whole, part in zip(solution.at(t), solution._first(50).at(t), strict=True):
        np.testing.assert_array_equal(whole, part)


@pytest.mark.parametrize("tau", [0.7, 0.01])
@pytest.mark.parametrize("method", ["eig3", "rk4", "ab3", "eig5"])
def test_critical_step_from_both_sides(method, tau):
    """With the short relaxation time, z limits the step; runs of 3000 steps grow by more than 1e4 beyond the limit."""
    problem = eig3.Problem("solid", solid, [1.0], [0.3], [4.0, 30.0, tau], (0.0, 1.0), z0=0.2)
    limit = problem.critical_step(method=method, safety=1.0).limit
    t_end = 3000 * limit
    stable = problem.integrate(h=0.98 * limit, method=method, t_end=t_end, save_every=None)
    assert np.abs([stable.u[-1, 0], stable.z["z"][-1]]).max() < 2
    grown = problem.integrate(h=1.02 * limit, method=method, t_end=t_end, save_every=None)
    assert np.abs([grown.u[-1, 0], grown.z["z"][-1]]).max() > 1e4


def test_an_invariant_with_z_is_conserved():
    """Without relaxation, z is a spring: the energy of the motion is constant up to the tolerance."""

    @eig3.jit
    def coupled(t, u, v, z, p, a, dz):
        a[0], dz[0] = -u[0] - 2 * z[0], 2 * v[0]

    energy = eig3.jit(lambda t, u, v, z, p: (v[0] ** 2 + u[0] ** 2 + z[0] ** 2) / 2)
    solution = eig3.integrate(
        coupled, (0, 50), [1.0], [0.0], z0=0.0, rtol=1e-10, method="rk8", invariants={"energy": energy}
    )
    assert solution.drift["energy"] < 1e-8
    assert solution.drift["energy"] > 0


def test_names_shapes_and_functions_without_z():
    @eig3.jit
    def many(t, u, v, z, p, a, dz):
        a[0], a[1] = -u[0], -u[1]
        dz[0] = u[0]
        dz[1], dz[2] = v[0], v[1]

    size = eig3.jit(lambda t, u, v, p: float(u.size + v.size))
    z0 = {"area": 1.0, "copies": [0.3, 0.4]}
    solution = eig3.integrate(many, (0, 2), [0.1, 0.2], [0.5, 0.6], z0=z0, h=1e-3, method="rk4", outputs={"n": size})
    assert solution.z.keys() == z0.keys()
    assert solution.z["copies"].shape == (len(solution.t), 2)
    np.testing.assert_allclose(solution.z["copies"], solution.u + 0.2, rtol=0, atol=1e-9)
    assert set(solution.outputs["n"]) == {4.0}
    assert [*solution.to_pandas().columns[-3:]] == ["area", "copies[0]", "copies[1]"]
    assert "copies" in solution.to_xarray()


def test_z_between_the_saved_states():
    """Polynomials of the fifth degree over steps of 0.01, or the continuous extension of RK8; also in a copy."""
    times = np.array([0.0, 0.123, 1.456, END])
    true = [exact(t)[2] for t in times]
    for options, bound in (({"h": 0.01, "method": "rk8"}, 1e-11), ({"rtol": 1e-9, "method": "rk8"}, 1e-8)):
        solution = run(**options)
        assert np.abs(solution.z_at(times)["z"] - true).max() < bound
        assert np.abs(solution.at(times)[0][:, 0] - [exact(t)[0] for t in times]).max() < bound
    copied = pickle.loads(pickle.dumps(run(h=0.01, method="rk8")))
    assert np.abs(copied.z_at(times)["z"] - true).max() < 1e-11
    assert np.isscalar(copied.z_at(1.0)["z"])
    np.testing.assert_array_equal(copied.a, run(h=0.01, method="rk8").a)
    with pytest.raises(ValueError, match="within the span"):
        copied.z_at(4.0)
    np.testing.assert_allclose(run(rtol=1e-9, t_eval=times, method="rk8").z["z"], true, rtol=0, atol=1e-8)


def test_accelerations_at_saved_states():
    solution = run(h=0.01)
    expected = -P[0] * solution.u[:, 0] - P[1] * solution.z["z"]
    np.testing.assert_allclose(solution.a[:, 0], expected, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("options", [{"h": 0.01}, {"rtol": 1e-8}], ids=["h", "rtol"])
def test_events_read_z_and_change_it(options):
    """At each occurrence, z is set to 0.5: then it falls again, and the state jumps."""

    @eig3.jit
    def lifted(t, u, v, z, p):
        z[0] = 0.5

    found = run(events={"empty": eig3.Event(stretch)}, **options).events["empty"]
    assert len(found) > 1
    np.testing.assert_allclose([exact(t)[2] for t in found.t], 0, atol=2e-4 if "h" in options else 1e-7)
    changed = run(events={"empty": eig3.Event(stretch, direction=-1, apply=lifted)}, **options)
    assert len(changed.events["empty"])
    t = changed.events["empty"].t[0]
    assert changed.events["empty"].u.shape == (len(changed.events["empty"]), 1)
    np.testing.assert_array_equal(changed.events["empty"].z_after["z"], 0.5)
    np.testing.assert_allclose(changed.events["empty"].z["z"], 0.0, rtol=0, atol=1e-12)
    assert changed.z_at(t)["z"] == 0.5
    assert changed.z_at(t + 1e-4)["z"] == pytest.approx(0.5 + 1e-4 * (changed.at(t)[1][0] - 0.5 / P[2]), abs=1e-6)
    # Within a step of 0.01, EIG-3 has errors of about 1e-5.
    assert changed.z_at(t - 1e-4)["z"] == pytest.approx(-1e-4 * changed.at(t)[1][0], abs=1e-5)
    assert {"z", "z_after"} <= {*changed.events["empty"].to_pandas().columns}
    assert run(events={"down": eig3.Event(first_position, terminal=True)}, **options).status is eig3.Status.TERMINATED


@pytest.mark.parametrize("options", [{"h": 0.01}, {"rtol": 1e-8, "method": "rk8"}], ids=["h", "rtol"])
def test_files_and_extension_have_z(options, tmp_path):
    outputs = {"force": (force, 2)}
    whole = run(span=(0, 2 * END), outputs=outputs, **options)
    part = run(outputs=outputs, save_to=tmp_path / "part", **options)
    part.save(tmp_path / "file")
    for found in (part, *(eig3.load(tmp_path / x, rhs=solid, outputs=outputs) for x in ("part", "file"))):
        np.testing.assert_array_equal(found.a, part.a)
        assert_same(found.extend(2 * END), whole)
    np.testing.assert_array_equal(eig3.load(tmp_path / "file").z["z"], part.z["z"])


@pytest.mark.parametrize(
    "options",
    [{"h": 0.01, "method": name} for name in ("eig3", "cd", "rk4", "ab3")] + [{"rtol": 1e-8, "method": "rk8"}],
    ids=lambda options: options["method"],
)
def test_members_run_in_lanes(options):
    """A member in lanes has the bits of a single run with fixed steps; with tolerances up to the order of sums."""
    params = P * np.linspace(0.8, 1.2, 24)[:, None]
    z0 = np.linspace(0, 1, 24)[:, None]
    members = eig3.ensemble(solid, (0, END), START[:1], START[1:2], z0=z0, params=params, **options)
    assert members.notes == ()
    for i in (0, 13, 23):
        alone = run(start=[*START[:2], z0[i, 0]], params=params[i], **options)
        tolerance = 0 if "h" in options else 1e-13
        np.testing.assert_allclose(members.u[i, -1], alone.u[-1], rtol=0, atol=tolerance)
        np.testing.assert_allclose(members.z["z"][i, -1], alone.z["z"][-1], rtol=0, atol=tolerance)
        np.testing.assert_allclose(members[i].a[-1], alone.a[-1], rtol=0, atol=tolerance)


def test_ensembles_keep_z_in_files_and_tables(tmp_path):
    z0 = {"stretch": np.linspace(0, 1, 5)}
    members = eig3.ensemble(
        solid, (0, END), START[:1], START[1:2], z0=z0, params=P, h=0.01, t_eval=[0, 1, END], outputs={"s": stretch}
    )
    assert members.z["stretch"].shape == (5, 3)
    np.testing.assert_array_equal(members.outputs["s"], members.z["stretch"])
    np.testing.assert_array_equal(members.summary()["stretch"], members.z["stretch"][:, -1])
    assert members.to_xarray()["stretch"].dims == ("member", "t")
    members.save(tmp_path / "members")
    loaded = eig3.load(tmp_path / "members", rhs=solid)
    np.testing.assert_array_equal(loaded[2].a, members[2].a)


def test_problems_have_z0():
    problem = eig3.Problem(
        "solid", solid_with_names, [1.0], [0.3], {"k": 4.0, "k1": 1.5, "tau": 0.7}, (0.0, END), z0={"stretch": 0.2}
    )
    one = problem.integrate(h=0.01)
    np.testing.assert_array_equal(last(one), last(run(h=0.01)))
    assert copy.copy(problem).with_(z0={"stretch": 0.5}).integrate(h=0.01).z["stretch"][0] == 0.5
    prepared = pickle.loads(pickle.dumps(problem.prepare(h=0.01)))
    np.testing.assert_array_equal(prepared().u, one.u)
    assert prepared(z0={"stretch": 0.4}).z["stretch"][0] == 0.4
    members = problem.ensemble(h=0.01, z0={"stretch": [0.1, 0.2]}, params={"k": np.array([3.0, 4.0])})
    np.testing.assert_array_equal(last(members[1]), last(one))
    plan = eig3.plan(problem, 1e-6, methods=["eig5", "rk8"])
    assert plan.best.method.name in ("eig5", "rk8")


def test_a_copy_knows_whether_an_array_of_z0_changes():
    problem = eig3.Problem("link", forced, [1.0, 0.0], [0.0, 0.0], 1.0, (0.0, 1.0), z0={"z": [0.0, 0.5]}, exact=np.sin)
    assert problem.with_(z0={"z": [0.0, 0.5]}).exact is np.sin
    other = problem.with_(z0={"z": [0.0, 0.6]})
    assert other.exact is not np.sin
    assert other.z0["z"].tolist() == [0.0, 0.6]


def test_errors_and_accuracy_of_z():
    """The estimates are within a factor of 2 of the true errors."""
    checked = run(h=0.02, check=True)
    true = checked.z["z"] - [exact(t)[2] for t in checked.t]
    found = checked.error.z["z"]
    assert 0.5 < np.abs(found).max() / np.abs(true).max() < 2
    reached = run(accuracy={"z": 1e-9}, t_eval=np.linspace(0, END, 7))
    assert np.abs(reached.z["z"] - [exact(t)[2] for t in reached.t]).max() < 1e-9


def test_the_memory_for_errors_has_z(monkeypatch):
    """Four histories of t, u, v and z, or in an ensemble of u, v and z, with 8 bytes for a value."""
    monkeypatch.setattr("eig3.result.memory.available_memory", lambda: 8e6)
    with pytest.raises(MemoryError, match=r"the estimated error needs 1.28e.07 bytes"):
        run(span=(0, 1), h=1e-5, check=True)
    with pytest.raises(MemoryError, match=r"the estimated error needs 9.61e.06 bytes"):
        eig3.ensemble(solid, (0, 1), np.ones((100, 1)), [0.3], z0=0.2, params=P, h=1e-3, save_every=1, check=True)


def test_sensitivities_and_fits_find_z0():
    problem = eig3.Problem("solid", solid, [1.0], [0.3], P, (0.0, END), z0={"stretch": 0.2})
    found = eig3.sensitivities(problem, ["stretch", "p[2]"], h=2e-3, method="rk4")
    assert found["stretch"].z["stretch"][-1] == pytest.approx(exact(END, start=[0, 0, 1])[2], abs=1e-9)
    step = np.array([0, 0, 1e-5])
    difference = (exact(END, P + step)[0] - exact(END, P - step)[0]) / 2e-5
    assert found["p[2]"].u[-1, 0] == pytest.approx(difference, abs=1e-7)
    t = np.linspace(0, END, 31)
    measured = np.array([exact(x, start=[1.0, 0.3, 0.35])[:1] for x in t])
    fitted = eig3.fit(problem, (t, measured), ["stretch", "p[2]"], h=2e-3, method="rk4")
    assert fitted.values["stretch"] == pytest.approx(0.35, abs=1e-6)


def test_inline_compiles_z_too():
    np.testing.assert_allclose(last(run(h=0.01, inline=True)), last(run(h=0.01)), rtol=0, atol=1e-13)


acceleration = eig3.jit(lambda t, u, v, p: -u)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"z0": None}, "rhs has first-order unknowns z: give their first values as z0"),
        ({"z0": np.nan}, "z0 must be finite"),
        ({"z0": {}}, "z0 must have at least one"),
        ({"z0": {"a": []}}, "z0['a'] must hold at least one value"),
        ({"z0": [[1.0]]}, "z0 must be a number or a one-dimensional array"),
        ({"z0": {1: 0.0}}, "the names in z0 must be strings"),
        ({"z0": 0.0, "u0": 1.0, "v0": 0.0}, "with z0, u0 and v0 must be arrays"),
        ({"z0": 0.0, "rhs": acceleration}, "with z0, rhs must have the form (t, u, v, z, p, a, dz)"),
        ({"z0": 0.0, "method": "rkn12"}, "needs a rhs that ignores v and has no z0"),
        (
            {"z0": 0.0, "method": eig3.CentralDifference(solver="newton", jacobian=force)},
            "method must be without a jacobian",
        ),
    ],
)
def test_wrong_arguments_are_refused_in_a_sentence(given, said):
    options = {"rhs": solid, "t_span": (0, 1), "u0": [1.0], "v0": [0.0], "params": P, "h": 0.1} | given
    with pytest.raises((TypeError, ValueError), match=re.escape(said)):
        eig3.integrate(**options)


def test_all_calls_say_where_z0_is_given():
    said = "rhs has first-order unknowns z: give their first values as z0, to eig3.integrate, prepare, ensemble or"
    for call in (
        lambda: eig3.Stepper(solid, [1.0], [0.0], h=0.1, params=P),
        lambda: eig3.critical_step(solid, [1.0], [0.0], P),
        lambda: eig3.prepare(solid, h=0.1),
        lambda: eig3.ensemble(solid, (0, 1), [[1.0]], [0.0], h=0.1, params=P),
        lambda: eig3.Problem("solid", solid, [1.0], [0.0], P, (0, 1)).integrate(h=0.1),
    ):
        with pytest.raises(TypeError, match=re.escape(said)):
            call()


@eig3.jit
def spring_of_z(t, u, v, z, p, a, dz):
    a[0] = -p[0] * z[0] - p[1] * v[0]
    dz[0] = v[0]


@pytest.mark.parametrize(
    ("method", "damping", "h", "said"),
    [
        ("eig3", 0.0, 0.05, "EIG3(alpha=1.0, beta=0.5) is unstable at every step for this system"),
        ("ab2", 0.0, 0.05, "AB2() is unstable at every step for this system"),
        ("rk4", 0.0, 0.05, ""),
        ("eig3", 0.2, 0.05, ""),
        ("eig3", 0.002, 0.3, "h = 0.3 is longer than the critical step 0.1581 of EIG3"),
    ],
)
def test_a_run_says_if_it_is_unstable_with_z(method, damping, h, said):
    """An undamped oscillation grows by (omega h)^4 / 4 in a step: stable up to about (omega h)^3 = 2 c / omega."""
    run = eig3.integrate(spring_of_z, (0, 6), [0.0], [1.0], z0=0.0, params=[1.0, damping], h=h, method=method)
    notes = [note for note in run.notes if "critical" in note or "unstable" in note]
    assert [note.startswith(said) for note in notes] == [True] * bool(said)


def test_a_run_that_diverges_and_one_that_is_stiff_are_explained():
    problem = eig3.Problem("solid", solid, [1.0], [0.0], [4.0, 30.0, 0.01], (0.0, 30.0), z0=0.2)
    why = problem.integrate(h=0.0105).explain()
    limit = problem.critical_step(safety=1.0).limit
    assert f"the critical step of EIG3(alpha=1.0, beta=0.5) is {limit:.4g}" in why
    stiff = problem.with_(params=[4.0, 30.0, 1e-3]).integrate(rtol=1e-4, method="rk5")
    assert any("The motion is stiff" in note for note in stiff.notes)


def test_other_starts_keep_names_and_shapes():
    problem = eig3.Problem("solid", solid, [1.0], [0.3], P, (0.0, END), z0={"stretch": 0.2})
    for call in (problem.prepare(h=0.1), lambda z0: problem.with_(z0=z0), lambda z0: problem.ensemble(h=0.1, z0=z0)):
        with pytest.raises(TypeError, match="z0 must have the names stretch"):
            call(z0={"stretching": 0.2})
    two = eig3.Problem("link", forced, [1.0, 0.0], [0.0, 0.0], 1.0, (0.0, 1.0), z0={"link": 0.1, "filter": 0.0})
    assert two.with_(z0={"filter": 0.5}).z0 == {"link": 0.1, "filter": 0.5}
    with pytest.raises(ValueError, match=re.escape("z0['stretch'] must")):
        problem.prepare(h=0.1)(z0={"stretch": [np.inf]})
    with pytest.raises(TypeError, match=r"z0 needs z0 in eig3\.prepare too"):
        eig3.prepare(acceleration, h=0.1)((0, 1), 1.0, 0.0, z0=1.0)
    with pytest.raises(ValueError, match="which a stepper does not support"):
        problem.stepper(h=0.1)
    with pytest.raises(ValueError, match="problem must have no first-order unknowns that rhs reads"):
        eig3.report(problem)
    with pytest.raises(TypeError, match="has no first-order unknowns"):
        eig3.problems.duffing().ensemble(h=0.1, z0=0.0)
    energetic = eig3.Problem("solid", solid, [1.0], [0.3], P, (0.0, END), z0=0.2, energy=stretch)
    with pytest.raises(ValueError, match="energy_of needs z too"):
        energetic.energy_of([1.0], [0.0])
    assert energetic.energy_of([1.0], [0.0], z={"z": 0.7}) == 0.7


def test_a_run_that_stopped_before_its_first_saved_state_goes_on(tmp_path):
    """Neither the run nor the first part of the ensemble has values of z."""
    options = {"h": 0.01, "params": P, "t_eval": [2.0, END]}
    whole = eig3.integrate(solid, (0, END), [1.0], [0.3], z0=0.2, **options)
    stopped = eig3.integrate(solid, (0, END), [1.0], [0.3], z0=0.2, **options, cancel=After(0))
    path = stopped.save(tmp_path / "run.npz")
    assert not stopped.t.size
    assert_same(eig3.load(path, rhs=solid).extend(END), whole)
    members = eig3.ensemble(solid, (0, END), np.ones((200, 1)), [0.3], z0=0.2, **options, save_to=tmp_path / "members")
    (tmp_path / "members" / "part-000000000000.npz").unlink()
    resumed = eig3.load(tmp_path / "members", rhs=solid).resume()
    np.testing.assert_array_equal(resumed.z["z"], members.z["z"])
