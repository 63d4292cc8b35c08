"""Parameters with names: the same numbers as with an array, in every kind of run, and clear errors."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
import scipy.sparse

import eig3
from eig3.functions.layout import Layout
from eig3.kernels.compile.numba_internals import compile_results

from .conftest import assert_same, position

H = {"h": 0.01}
RTOL = {"rtol": 1e-8, "method": "rk5"}
KINDS = {"by address": H, "inline": {**H, "inline": True}}


class Spring(NamedTuple):
    k: float
    c: float
    power: int


@eig3.jit
def spring(t, u, v, p):
    return -p.k * u**p.power - p.c * v


spring_of_array = eig3.jit(lambda t, u, v, p: -p[0] * u ** int(p[2]) - p[1] * v)
pull_of_array = eig3.jit(lambda t, u, v, p: -p[0] * u)
energy = eig3.jit(lambda t, u, v, p: v * v / 2 + p.k * u * u / 2)


@eig3.jit
def force(t, u, v, p, out):
    out[0], out[1] = p.k * u, p.c * v


bounce = eig3.jit(lambda t, u, v, p: (u, -p.c * v))


@eig3.jit
def chain(t, u, v, p, a):
    """All kinds of parameters: a number, an integer, arrays, a matrix and a sparse matrix."""
    for i in range(u.size):
        total = p.gaps[p.group[i]]
        for k in range(p.K.indptr[i], p.K.indptr[i + 1]):
            total += p.K.data[k] * u[p.K.indices[k]]
        for j in range(p.C.shape[1]):
            total += p.C[i, j] * v[j]
        a[i] = -p.scale * total - p.table[p.row, i % 2]


def chain_parameters(n, scale=1.5):
    K = scipy.sparse.diags_array([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    group = np.arange(n) % 3
    table = np.array([[0.1, 0.2], [0.3, -0.4]])
    C = 0.1 * np.eye(n)
    return {"scale": scale, "row": 1, "gaps": [0.0, 0.2, -0.1], "group": group, "C": C, "K": K, "table": table}


def chain_by_numpy(p, u, v):
    K, table = p["K"].toarray(), np.asarray(p["table"])
    total = np.asarray(p["gaps"])[p["group"]] + K @ u + p["C"] @ v
    return -p["scale"] * total - table[p["row"], np.arange(len(u)) % 2]


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
def test_a_run_has_the_bits_of_one_with_an_array(options):
    values = {"k": 4.0, "c": 0.1, "power": 1}
    array = eig3.integrate(spring_of_array, (0, 3), 1.0, 0.0, params=[4.0, 0.1, 1], **options)
    for params in (values, Spring(**values), eig3.Parameters(values)):
        named = eig3.integrate(spring, (0, 3), 1.0, 0.0, params=params, **options)
        assert_same(named, array, "tua")


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
def test_events_invariants_and_outputs_have_the_names_too(options):
    given = {"events": {"floor": eig3.Event(position, -1, apply=bounce)}, "invariants": {"energy": energy}}
    given |= {"params": Spring(4.0, 0.5, 1), "outputs": {"force": (force, 2), "u": position}}
    run = eig3.integrate(spring, (0, 3), 1.0, 0.0, **given, **options)
    assert run.events["floor"].v_after == pytest.approx(-0.5 * run.events["floor"].v, rel=1e-15)
    np.testing.assert_array_equal(run.outputs["force"], np.column_stack([4.0 * run.u, 0.5 * run.v]))
    assert run.drift["energy"] > 0.1


@pytest.mark.parametrize("options", [H, RTOL], ids=["fixed", "tolerances"])
def test_every_kind_of_parameter(options):
    rng, n = np.random.default_rng(0), 7
    u0, v0 = rng.normal(size=(2, n))
    p = chain_parameters(n)
    run = eig3.integrate(chain, (0, 0.1), u0, v0, params=p, **options)
    np.testing.assert_allclose(run.a[-1], chain_by_numpy(p, run.u[-1], run.v[-1]), rtol=1e-13)


def test_sizes_are_read_and_not_compiled():
    layouts = {eig3.Parameters(chain_parameters(n)).layout for n in (3, 5, 8)}
    (layout,) = layouts
    bound = layout.bind(chain)
    eig3.integrate(chain, (0, 0.1), np.ones(4), np.zeros(4), params=chain_parameters(4), **H)
    count = len(compile_results(bound))
    for n in (3, 5, 8):
        p = chain_parameters(n)
        run = eig3.integrate(chain, (0, 0.1), np.ones(n), np.zeros(n), params=p, **H)
        np.testing.assert_allclose(run.a[0], chain_by_numpy(p, np.ones(n), np.zeros(n)), rtol=1e-13)
    assert layout.bind(chain) is bound
    assert len(compile_results(bound)) == count


def test_what_the_force_reads_is_known():
    """So "cd" stays explicit, and the default for tolerances is the method for forces without velocity."""
    undamped = eig3.jit(lambda t, u, v, p: -p.k * u)
    p = {"k": 4.0}
    assert eig3.integrate(undamped, (0, 1), 1.0, 0.0, params=p, rtol=1e-9).method == eig3.RKN12()
    problem = eig3.Problem("spring", undamped, 1.0, 0.0, p, (0.0, 1.0))
    assert not problem.uses_velocity
    assert eig3.Problem("spring", spring, 1.0, 0.0, Spring(4.0, 0.1, 1), (0.0, 1.0)).uses_velocity


def make_problem(**changes):
    params = Spring(4.0, 0.1, 1)._replace(**changes)
    events = {"middle": eig3.Event(position)}
    return eig3.Problem("spring", spring, 1.0, 0.0, params, (0.0, 3.0), energy=energy, events=events)


def test_the_function_of_a_problem_takes_its_array_too():
    problem = make_problem()
    p = np.array([4.0, 0.1, 1.0])
    expected = problem.integrate(invariants={}, events={}, **H).u
    for run in (
        eig3.integrate(problem.rhs, (0, 3), 1.0, 0.0, params=p, **H),
        eig3.prepare(problem.rhs, **H)((0, 3), 1.0, 0.0, p),
    ):
        np.testing.assert_array_equal(run.u, expected)


@pytest.mark.parametrize("options", [H, RTOL], ids=["fixed", "tolerances"])
def test_a_problem(options, tmp_path):
    problem = make_problem()
    assert problem.params.k == problem.params["k"] == 4.0
    run = problem.integrate(outputs={"force": (force, 2)}, **options)
    plain = eig3.integrate(spring_of_array, (0, 3), 1.0, 0.0, params=[4.0, 0.1, 1], **options)
    assert run.u[-1] == pytest.approx(plain.u[-1], abs=1e-12)
    stiff = problem.with_(params={"k": 9.0, "c": 0.1, "power": 1})
    assert stiff.params == problem.params._replace(k=9.0)
    assert stiff.integrate(**options).u[-1] == problem.prepare(**options)(params=Spring(9.0, 0.1, 1)).u[-1]
    run.save(tmp_path / "run.npz")
    loaded = problem.load(tmp_path / "run.npz", outputs={"force": (force, 2)})
    functions = {"outputs": {"force": (force, 2)}, "invariants": {"energy": energy}, "events": problem.events}
    other = eig3.load(tmp_path / "run.npz", rhs=spring, **functions)
    for each in (loaded, other):
        np.testing.assert_array_equal(each.extend(4.0).u, run.extend(4.0).u)


def test_integers_survive_a_file(tmp_path):
    """Their bits are those of numbers that are not normal, or NaN."""
    n = 4
    p = chain_parameters(n) | {"group": np.array([0, 2, 1, -1])}
    run = eig3.integrate(chain, (0, 0.1), np.ones(n), np.zeros(n), params=p, **H)
    run.save(tmp_path / "run.npz")
    loaded = eig3.load(tmp_path / "run.npz", rhs=chain)
    np.testing.assert_array_equal(loaded.extend(0.2).u, run.extend(0.2).u)


def test_functions_take_the_parameters_of_a_problem_in_calls_from_python():
    """The function of the user gets the tuple, and the function of the problem the array."""
    matrix = scipy.sparse.csr_array(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    pull = eig3.jit(lambda t, u, v, p: -p.k * u - p.matrix.data[0])
    problem = eig3.Problem("pull", pull, 1.0, 0.0, {"k": 3.0, "matrix": matrix}, (0, 1))
    assert pull(0.0, 0.5, 0.0, problem.params) == problem.rhs(0.0, 0.5, 0.0, problem.params) == -3.5


def test_steppers_critical_steps_and_plans():
    problem = make_problem(c=0.0).with_(events={})
    assert problem.critical_step().omega_max == pytest.approx(2.0, rel=1e-6)
    assert eig3.critical_step(spring, 1.0, 0.0, Spring(9.0, 0.0, 1)).omega_max == pytest.approx(3.0, rel=1e-6)
    stepper = eig3.Stepper(spring, 1.0, 0.0, h=0.01, params=Spring(4.0, 0.1, 1))
    stepper.advance(300)
    assert stepper.u == eig3.integrate(spring, (0, 3), 1.0, 0.0, params=Spring(4.0, 0.1, 1), **H).u[-1]
    assert eig3.plan(problem, 1e-3, methods=["eig3"]).best.h > 0


@pytest.mark.parametrize("method", ["cd", "ab3"])
def test_a_controller_changes_the_parameters_of_a_stepper(method):
    """As two prepared runs, of which the second has other parameters: methods forget the past accelerations."""
    stepper = eig3.Stepper(spring, 1.0, 0.0, h=0.01, params=Spring(4.0, 0.1, 1), method=method)
    first = stepper.fork()
    stepper.advance(10)
    stepper.params = Spring(9.0, 0.1, 1)
    stepper.advance(10)
    run = eig3.prepare(spring, h=0.01, params=Spring(4.0, 0.1, 1), method=method)
    before = run((0, 0.1), 1.0, 0.0, Spring(4.0, 0.1, 1))
    after = run((0.1, 0.2), before.u[-1], before.v[-1], Spring(9.0, 0.1, 1))
    assert stepper.u == pytest.approx(after.u[-1], rel=1e-14)  # of other roundings of t, which spring does not read
    assert first.params.tolist() == [4.0, 0.1, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        stepper.params[0] = 16.0
    with pytest.raises(TypeError, match="params must have power too"):
        stepper.params = {"k": 1.0, "c": 0.0}
    with pytest.raises(ValueError, match=r"params must keep their shape \(1,\), and not have \(2,\)"):
        eig3.Stepper(pull_of_array, 1.0, 0.0, h=0.01, params=[1.0]).params = [1.0, 2.0]


def test_a_jacobian_has_the_names():
    derivative = eig3.jit(lambda t, u, v, p: -p.c)
    method = eig3.CentralDifference(solver="newton", jacobian=derivative)
    run = eig3.integrate(spring, (0, 3), 1.0, 0.0, params=Spring(4.0, 0.1, 1), method=method, **H)
    plain = eig3.CentralDifference(solver="newton")
    assert run.u[-1] == pytest.approx(
        eig3.integrate(spring, (0, 3), 1.0, 0.0, params=Spring(4.0, 0.1, 1), method=plain, **H).u[-1], abs=1e-9
    )


# Ensembles ------------------------------------------------------------------------------------------------------------

switched = eig3.jit(lambda t, u, v, p: -p.k * u - p.is_damped * p.c * v)


def test_members_have_values_of_their_own():
    k = np.linspace(1.0, 9.0, 40)
    params = {"k": k, "c": 0.1, "is_damped": 1}
    runs = eig3.ensemble(switched, (0, 3), 1.0, 0.0, params=params, outputs={"force": (force, 2)}, **H)
    assert not runs.notes  # they run in lanes
    for i in (0, 39):
        alone = eig3.integrate(switched, (0, 3), 1.0, 0.0, params={**params, "k": k[i]}, save_every=None, **H)
        assert runs.u[i, -1] == pytest.approx(alone.u[-1], abs=1e-12)


@eig3.jit
def on_a_road(t, u, v, p):
    return p.k * (eig3.math.interp(t, p.times, p.road) - u) - p.c * v


def test_members_share_the_tables_that_do_not_differ():
    """A table of each member would be searched in each lane alone, which is not vectorised."""
    t, k = np.linspace(0, 3, 31), np.linspace(1.0, 9.0, 40)
    params = {"k": k, "c": 0.1, "times": t, "road": np.sin(t)}
    runs = eig3.ensemble(on_a_road, (0, 3), np.zeros(40), 0.0, params=params, **H)
    assert not runs.notes
    alone = eig3.integrate(on_a_road, (0, 3), 0.0, 0.0, params={**params, "k": k[7]}, **H)
    assert runs.u[7, -1] == pytest.approx(alone.u[-1], abs=1e-12)


@eig3.jit
def springs(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p.k[j] * u[j] - p.c * v[j]


def test_arrays_and_sparse_matrices_of_members():
    k = np.random.default_rng(1).uniform(1, 9, (20, 3))
    runs = eig3.ensemble(springs, (0, 3), np.ones((20, 3)), np.zeros(3), params={"k": k, "c": 0.1}, **H)
    assert not runs.notes
    alone = eig3.integrate(springs, (0, 3), np.ones(3), np.zeros(3), params={"k": k[7], "c": 0.1}, **H)
    np.testing.assert_allclose(runs.u[7, -1], alone.u[-1], rtol=0, atol=1e-12)
    p = chain_parameters(4)
    scales = np.linspace(1, 2, 5)
    runs = eig3.ensemble(chain, (0, 1), np.ones((5, 4)), np.zeros(4), params={**p, "scale": scales}, **H)
    alone = eig3.integrate(chain, (0, 1), np.ones(4), np.zeros(4), params={**p, "scale": scales[2]}, **H)
    np.testing.assert_allclose(runs.u[2, -1], alone.u[-1], rtol=0, atol=1e-12)


@eig3.jit
def rows_of_entries(t, u, v, p, a):
    for i in range(u.size):
        a[i] = 0.0
        for k in range(p.K.indptr[i], p.K.indptr[i + 1]):
            a[i] -= p.scale * p.K.data[k] * u[p.K.indices[k]]


@pytest.mark.parametrize("steps", [{"h": 0.01}, {"rtol": 1e-6, "method": "rk8"}])
def test_members_with_a_sparse_matrix_and_parameters_of_their_own_run_one_at_a_time(steps):
    """The columns of the matrix are pairs of whole numbers in one real one, which a lane cannot read."""
    K, scales = chain_parameters(2)["K"], np.linspace(1, 2, 16)
    problem = eig3.Problem("rows", rows_of_entries, np.ones(2), np.zeros(2), {"K": K, "scale": 1.0}, (0, 1))
    runs = problem.ensemble(params={"scale": scales}, **steps)
    assert "because params have a sparse matrix and differ between members" in runs.notes[0]
    alone = problem.with_(params=problem.params._replace(scale=scales[7])).integrate(**steps)
    np.testing.assert_array_equal(runs.u[7, -1], alone.u[-1])
    assert not any("sparse" in note for note in problem.ensemble(u0=np.ones((16, 2)), **steps).notes)


def test_each_member_can_have_a_sparse_matrix():
    K = chain_parameters(2)["K"]
    problem = eig3.Problem("rows", rows_of_entries, np.ones(2), np.zeros(2), {"K": K, "scale": 1.0}, (0, 1))
    runs = problem.ensemble(params=[{"K": factor * K} for factor in (1.0, 1.1)], **H)
    scaled = problem.ensemble(params={"scale": [1.0, 1.1]}, **H)
    np.testing.assert_allclose(runs.u, scaled.u, rtol=0, atol=1e-13)  # the products are rounded in another order


@eig3.jit
def whole_array(t, u, v, p, a):
    k = np.asarray(p.k)
    if k.ndim > 1:
        raise ValueError("a number or an array of one axis")
    for j, x in enumerate(u):
        a[j] = -k.flat[j % k.size] * x


def test_an_array_as_long_as_there_are_members_must_have_one_meaning():
    """With 3 members of 3 degrees of freedom, k may be a number a member, or an array that they share."""
    k, u0 = np.array([1.0, 4.0, 9.0]), np.ones((3, 3))
    each = [eig3.integrate(whole_array, (0, 1), u0[0], 0 * k, params={"k": x}, **H).u[-1] for x in (k, *k)]

    def ends(rhs, params):
        return eig3.ensemble(rhs, (0, 1), u0, 0 * k, params=params, **H).u[:, -1]

    message = (
        r"^params has an array k of the length 3 for 3 members, and rhs can also take it as a whole: write "
        r"k\[:, None\] for one value a member, or np\.array\(\[k\] \* 3\) for this array in all members\.$"
    )
    for rhs, params in ((whole_array, {"k": k}), (springs, {"k": k, "c": 0.1}), (springs, {"k": k, "c": 0 * k})):
        with pytest.raises(ValueError, match=message):
            ends(rhs, params)
    np.testing.assert_allclose(ends(whole_array, {"k": k[:, None]}), each[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(ends(whole_array, {"k": np.array([k] * 3)}), [each[0]] * 3, rtol=0, atol=1e-12)
    shared = ends(springs, {"k": np.array([k] * 3), "c": 0 * k})
    np.testing.assert_allclose(shared, [each[0]] * 3, rtol=0, atol=1e-12)


def test_an_ensemble_of_a_problem_changes_some_parameters():
    problem = make_problem().with_(events={})
    runs = problem.ensemble(params={"c": [0.1, 0.2, 0.3]}, **H)
    assert runs.u[2, -1] == pytest.approx(problem.with_(params=Spring(4.0, 0.3, 1)).integrate(**H).u[-1], abs=1e-12)
    assert len(problem.ensemble(u0=[1.0, 2.0], **H)) == 2
    assert len(problem.ensemble(u0=[1.0, 2.0, 3.0], **H)) == 3  # as many members as parameters


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"k": [1.0, 2.0], "c": [0.1, 0.2, 0.3], "power": 1}, "params has arrays of different lengths"),
        ({"k": [], "c": 0.1, "power": 1}, "params must hold at least one member, but an array is empty."),
    ],
)
def test_members_that_do_not_fit(params, message):
    with pytest.raises(ValueError, match=message):
        eig3.ensemble(spring, (0, 1), 1.0, 0.0, params=params, **H)


def test_a_lambda_expression_reads_names():
    problem = eig3.Problem("spring", eig3.jit(lambda t, u, v, p: -p.k * u), 1.0, 0.0, {"k": 4.0}, (0, 1))
    squares = {"square": eig3.jit(lambda t, u, v, z, p: p.k * z[0])}
    with_z = eig3.jit(lambda t, u, v, z, p, a, dz: a.fill(-p.k * u[0]) or dz.fill(2 * u[0] * v[0]))
    run = eig3.integrate(with_z, (0, 1), [1.0], [0.0], z0=1.0, params={"k": 4.0}, outputs=squares, method="rk8", **H)
    exact = np.cos(2.0)  # and RK8 has an error of about (omega h)^8
    assert problem.integrate(method="rk8", **H).u[-1] == pytest.approx(exact, abs=1e-13)
    assert run.outputs["square"][-1] == pytest.approx(4 * exact**2, abs=1e-12)


def test_values_for_other_numbers_of_members():
    params = {"k": [4.0, 5.0, 6.0], "c": 0.1, "power": 1}
    message = r"params\['k'\] has the length 3, but there are 4 members; give 4 values, one for each member\.$"
    with pytest.raises(TypeError, match=message):
        eig3.ensemble(spring, (0, 1), np.ones(4), 0.0, params=params, **H)
    with pytest.raises(ValueError, match="u0, v0 and h have first axes of different lengths"):
        eig3.ensemble(spring, (0, 1), np.ones(4), np.ones(3), params=params, **H)
    problem = eig3.Problem("spring", spring, 1.0, 0.0, Spring(4.0, 0.1, 1), (0, 1))
    with pytest.raises(ValueError, match=r"^params must hold at least one member, but an array is empty\.$"):
        problem.ensemble(params={"k": []}, **H)
    with pytest.raises(TypeError, match=r"^k is a parameter: give params=\{'k': \.\.\.\} to with_"):
        problem.with_(k=5.0)
    with pytest.raises(ValueError, match=r"^params has values for different numbers of members: k 2, c 3\.$"):
        make_problem().with_(events={}).ensemble(params={"k": [1.0, 2.0], "c": [0.1, 0.2, 0.3]}, **H)


# Other processes ------------------------------------------------------------------------------------------------------


def test_copies_have_the_same_numbers():
    problem = make_problem()
    run = problem.integrate(**H)
    for copy in (pickle.loads(pickle.dumps(problem)), pickle.loads(pickle.dumps(problem.prepare(**H)))):
        again = copy() if isinstance(copy, eig3.Prepared) else copy.integrate(**H)
        np.testing.assert_array_equal(again.u, run.u)
    params = pickle.loads(pickle.dumps(eig3.Parameters(chain_parameters(3))))
    assert params == eig3.Parameters(chain_parameters(3))
    assert hash(params) == hash(eig3.Parameters(chain_parameters(3)))


@pytest.mark.system
def test_parts_run_in_other_processes():
    problem = make_problem().with_(events={})
    c = np.linspace(0, 1, 300)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        runs = problem.ensemble(params={"c": c}, executor=pool, **H)
    np.testing.assert_array_equal(runs.u, problem.ensemble(params={"c": c}, **H).u)


# Errors ---------------------------------------------------------------------------------------------------------------


@eig3.jit
def misspelt(t, u, v, p):
    return -p.kk * u


@eig3.jit
def writes(t, u, v, p, a):
    p.k[0] = 1.0
    a[0] = 0.0


@eig3.jit
def with_keys(t, u, v, p, a):
    a[0] = -p["k"] * u[0]


@pytest.mark.parametrize(
    ("rhs", "params", "error", "message"),
    [
        (with_keys, {"k": 4.0}, TypeError, r"parameters with names are p\.k, not p\['k'\]"),
        (misspelt, {"k": 4.0}, TypeError, "misspelt reads p.kk, but params has no kk: did you mean k?"),
        (spring, {"k": 4.0, "_c": 1.0}, TypeError, "the names in params must be names of Python without _ in front"),
        (spring, {"k": 4.0, "1c": 1.0}, TypeError, "the names in params must be names of Python"),
        (spring, {"k": 4.0, 3: 1.0}, TypeError, "the names in params must be names of Python"),
        (spring, {"k": 4 + 1j, "c": 1.0, "power": 1}, TypeError, r"params\['k'\] must be made of real numbers"),
        (spring, {"k": "4", "c": 1.0, "power": 1}, TypeError, r"params\['k'\] must be made of real numbers"),
        (spring, {"k": np.zeros((2, 2, 2))}, ValueError, r"params\['k'\] must have at most 2 axes, not the shape"),
        (spring, {"k": 2**60, "c": 1.0, "power": 1}, ValueError, r"params\['k'\] must be an integer below 2\^53"),
        (writes, {"k": [1.0]}, TypeError, "rhs must not write to u, v or p; it may only read them"),
    ],
)
def test_bad_parameters(rhs, params, error, message):
    u0 = [1.0] if rhs in (with_keys, writes) else 1.0
    with pytest.raises(error, match=message):
        eig3.integrate(rhs, (0, 1), u0, 0 * np.asarray(u0), params=params, **H)


@pytest.mark.parametrize("params", [(), [4.0]])
def test_a_run_without_the_names_that_its_function_reads(params):
    message = r"^rhs reads p\.k, but the parameters have no names: give params=\{'k': 1\.0, 'power': 1\.0, 'c': 1\.0\}"
    with pytest.raises(TypeError, match=message):
        eig3.integrate(spring, (0, 1), 1.0, 0.0, params=params, **H)
    with pytest.raises(TypeError, match=message):
        eig3.prepare(spring, **H)


def test_a_function_of_an_array_that_is_given_names():
    with pytest.raises(TypeError, match=r"^rhs does not compile .*, in which p has the names p\.k, p\.c: tuple index"):
        eig3.integrate(spring_of_array, (0, 1), 1.0, 0.0, params={"k": 1.0, "c": 0.1}, **H)


@pytest.mark.parametrize("given", [{"power": 3, "k": 9.0, "c": 0.1}, {"c": 0.1, "k": 9, "power": 3.0}])
def test_the_function_of_a_problem_takes_parameters_in_another_order_or_of_other_kinds(given):
    """It read them at the places of the parameters of its problem, and a longer array from other memory."""
    expected = eig3.integrate(spring, (0, 1), 1.0, 0.0, params=given, **H)
    rhs = make_problem().rhs
    np.testing.assert_array_equal(eig3.integrate(rhs, (0, 1), 1.0, 0.0, params=given, **H).u, expected.u)
    members = eig3.ensemble(rhs, (0, 1), [1.0, 1.0], 0.0, params=given, **H)
    np.testing.assert_allclose(members.u[:, -1], expected.u[-1], rtol=1e-14)
    with pytest.raises(TypeError, match=r"^spring reads p\.k, but params has no k: did you mean c\?$"):
        eig3.integrate(rhs, (0, 1), 1.0, 0.0, params={"c": 1.0}, **H)


def test_parameters_of_another_layout():
    problem = make_problem()
    refused = (
        r"^params must have power too: its names are k, c, power\. .* such as problem\.params\._replace\(k=\.\.\.\)\.$"
    )
    with pytest.raises(TypeError, match=refused):
        problem.prepare(**H)((0, 1), 1.0, 0.0, {"k": 1.0, "c": 0.1})
    assert problem.with_(params={"k": 1.0}).params == problem.params._replace(k=1.0)
    with pytest.raises(TypeError, match=r"^params has no cc: did you mean c\?$"):
        problem.with_(params={"k": 1.0, "cc": 0.1, "power": 1})
    with pytest.raises(
        TypeError, match=r"^params\['power'\] must be an integer, as at first, not a number; write 1\.0 "
    ):
        problem.with_(params={"k": 1.0, "c": 0.1, "power": 1.5})
    with pytest.raises(TypeError, match=r"^params must have the names k, c, power, and not be "):
        problem.with_(params=[1.0, 0.1, 1])
    assert problem.with_(params={"k": 9, "c": 0, "power": 1}).params.k == 9.0  # whole numbers are numbers too
    for call in (lambda **given: eig3.problems.duffing().with_(**given), eig3.problems.duffing().ensemble):
        with pytest.raises(TypeError, match=r"^params of duffing have no names: give 5 numbers for each run\.$"):
            call(params={"delta": [0.3, 0.2]})
    with pytest.raises(TypeError, match="params has the names k, but the run was prepared for an array: give params"):
        eig3.prepare(spring_of_array, **H)((0, 1), 1.0, 0.0, {"k": 4.0})
    with pytest.raises(TypeError, match="params is for parameters with names"):
        eig3.prepare(spring, params=[4.0], **H)
    prepared = eig3.prepare(spring, params=Spring(4.0, 0.1, 1), **H)
    assert prepared((0, 1), 1.0, 0.0, Spring(9.0, 0.1, 1)).success
    with pytest.raises(AttributeError, match=r"^parameters cannot be changed: take params\._replace\(k=\.\.\.\)\.$"):
        problem.params.k = 3.0
    with pytest.raises(AttributeError, match=r"^params has no q: did you mean k or c or power\?$"):
        _ = problem.params.q
    with pytest.raises(TypeError, match=r"^params has no q: did you mean k or c or power\?$"):
        problem.params._replace(q=1)
    with pytest.raises(ValueError, match=r"^the names of the parameters are damaged\.$"):
        Layout.of_text("k=real, os.system=real")


def test_parameters_say_what_they_are():
    text = repr(eig3.Parameters({**chain_parameters(20), "long": np.zeros(99)}))
    assert text.startswith("Parameters(scale=1.5, row=1, gaps=[0.0, 0.2, -0.1], group=<array 20>, C=<array 20 x 20>, ")
    assert "K=<sparse 20 x 20, 58 entries>" in text
    layout = eig3.Parameters(chain_parameters(3)).layout
    assert layout.text == "scale=real, row=whole, gaps=real1, group=whole1, C=real2, K=sparse, table=real2"
    assert Layout.of_text(layout.text) == layout


@eig3.jit
def of_blocks(t, u, v, p, a):
    edge = p.K.data.shape[1]
    for row in range(p.K.indptr.size - 1):
        for i in range(edge):
            total = 0.0
            for k in range(p.K.indptr[row], p.K.indptr[row + 1]):
                for j in range(edge):
                    total += p.K.data[k, i, j] * u[edge * p.K.indices[k] + j]
            a[edge * row + i] = -p.scale * total


@pytest.mark.parametrize(("edge", "options"), [(2, H), (3, RTOL)])
def test_a_matrix_of_blocks_keeps_them(edge, options):
    rng = np.random.default_rng(edge)
    dense = np.kron(np.diag([2.0, 3, 4, 5]) + np.eye(4, k=1), rng.normal(size=(edge, edge)))
    K = scipy.sparse.csr_array(dense).tobsr((edge, edge))
    u0 = rng.normal(size=4 * edge)
    run = eig3.integrate(of_blocks, (0, 0.1), u0, 0 * u0, params={"scale": 2.0, "K": K, "last": 7.0}, **options)
    np.testing.assert_allclose(run.a[0], -2.0 * dense @ u0, rtol=1e-13)
    parameters = eig3.Parameters({"K": K})
    assert parameters.layout.text == "K=blocks"
    assert Layout.of_text("K=blocks") == parameters.layout
    with pytest.raises(TypeError, match=r"params\['K'\] must be a sparse matrix of blocks, as at first, not a sparse"):
        parameters._replace(K=K.tocsr())


def test_members_may_have_parameters_each():
    problem = eig3.Problem("spring", spring, 1.0, 0.0, {"k": 4.0, "c": 0.1, "power": 1}, (0.0, 1.0))
    ks = [1.0, 2.0, 3.0]
    each = problem.ensemble(params=[problem.params._replace(k=k) for k in ks], h=0.01)
    np.testing.assert_array_equal(each.u, problem.ensemble(params={"k": ks}, h=0.01).u)
    values = [eig3.Parameters({"a": np.ones(n)}) for n in (2, 3)]
    sized = eig3.Problem("sized", first_of_array, 1.0, 0.0, values[0], (0.0, 1.0))
    for given in (values, {"a": [np.ones(2), np.ones(3)]}):
        with pytest.raises(ValueError, match=r"^params must have arrays of the same sizes for all members: resample"):
            sized.ensemble(params=given, h=0.01)


FRAME = pd.DataFrame({"k": [1.0, 2.0, 3.0], "c": [0.1, 0.2, 0.3], "power": [1, 1, 1]})
TABLES = {
    "DataFrame": FRAME,
    "list of dict": FRAME.to_dict("records"),
    "list of NamedTuple": [Spring(k, c, 1) for k, c in zip(FRAME.k, FRAME.c, strict=True)],
    "list of Parameters": [eig3.Parameters(row) for row in FRAME.to_dict("records")],
}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_table_of_parameters_has_a_row_for_each_member(table):
    """The members have the bits of the same numbers in a dictionary, in parts and on an executor too."""
    columns = {"k": FRAME.k.to_numpy(), "c": FRAME.c.to_numpy(), "power": 1}
    wanted = eig3.ensemble(spring, (0, 1), np.ones(3), 0.0, params=columns, invariants={"energy": energy}, **H)
    runs = eig3.ensemble(spring, (0, 1), 1.0, 0.0, params=table, invariants={"energy": energy}, **H)
    problem = make_problem().with_(events={}, u0=1.0, v0=0.0, t_span=(0, 1))
    with ThreadPoolExecutor(1) as pool:
        shipped = problem.ensemble(params=table, executor=pool, **H)
    for each in (runs, shipped, problem.ensemble(params=table, **H)):
        np.testing.assert_array_equal(each.u, wanted.u)
    assert list(runs.summary().columns[:2]) == ["k", "c"]
    by_array = eig3.ensemble(spring_of_array, (0, 1), 1.0, 0.0, params=table, **H)
    np.testing.assert_array_equal(by_array.u, eig3.ensemble(spring_of_array, (0, 1), 1.0, 0.0, params=FRAME, **H).u)


def test_a_table_of_the_parameters_that_change_and_of_arrays():
    problem = make_problem().with_(events={})
    runs = problem.ensemble(params=FRAME[["c"]], **H)
    np.testing.assert_array_equal(runs.u, problem.ensemble(params={"c": FRAME.c}, **H).u)
    rows = [{"a": [1.0, 9.0]}, {"a": [2.0, 9.0]}]
    runs = eig3.ensemble(first_of_array, (0, 1), 1.0, 0.0, params=rows, **H)
    cells = pd.DataFrame({"a": [row["a"] for row in rows]})
    np.testing.assert_array_equal(runs.u, eig3.ensemble(first_of_array, (0, 1), 1.0, 0.0, params=cells, **H).u)
    assert runs.u[1, -1] == pytest.approx(np.cos(np.sqrt(2)), abs=1e-4)  # the error of h = 0.01 is h^2 / 24


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (FRAME[["k", "power"]], r"^spring reads p\.c, but params has no c: did you mean k or power\?$"),
        (FRAME.assign(site="north"), r"^params must have numbers in site, .*: leave out what is not a parameter\.$"),
        (FRAME.assign(c=[0.1, np.nan, 0.3]), r"^params has no value of c in row 1: fill it in, or drop the row\.$"),
        (FRAME[:0], r"^params must hold at least one member, but the table has no rows\.$"),
        ([{"k": 1.0, "c": 0.1}, {"k": 1.0}], r"they are k, c in params\[0\] and k in params\[1\]: give each member"),
        ([{"k": 1.0}, 2.0], r"^params\[1\] must be a dictionary or a NamedTuple as the other members, not 2\.0\.$"),
        ([{"k": 1.0, "c": [1.0]}, {"k": 1.0, "c": [1.0, 2.0]}], r"values of c of the same shape in all members"),
        (FRAME[:2], r"^u0 has the shape \(3,\) and params the shape \(2, 3\), but their first axes are the members\.$"),
    ],
)
def test_tables_that_are_refused(table, message):
    with pytest.raises((TypeError, ValueError), match=message):
        eig3.ensemble(spring, (0, 1), np.ones(3), 0.0, params=table, **H)


def test_a_table_with_a_name_that_the_problem_does_not_have():
    with pytest.raises(TypeError, match=r"^params has no kk: did you mean k\?$"):
        make_problem().with_(events={}).ensemble(params=FRAME.rename(columns={"k": "kk"}), **H)


first_of_array = eig3.jit(lambda t, u, v, p: -p.a[0] * u)
