"""Ensembles in parts: on executors of all kinds, with workers that die, and with `reduce`."""

import gc
import multiprocessing
import os
import pickle
import re
import signal
import threading
import tracemalloc
import weakref
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from distributed import Client, LocalCluster

import eig3
from eig3.ensembles.members import check_members
from eig3.ensembles.parts import Joined, Listed, parts_of
from eig3.functions.companions import remembered
from eig3.kernels.compile.numba_internals import Jitted
from eig3.kernels.protocol import SCALAR, VECTOR
from eig3.stepping.run_options import run_options

from .conftest import BLOCKS, assert_same, linear_spring
from .test_pools import output

MEMBERS = 1000  # that is 8 parts: 7 of 128 members, and one of 104
STIFFNESS = np.linspace(1.0, 4.0, MEMBERS)[:, None]

energy = eig3.jit(lambda t, u, v, p: (v * v + p[0] * u * u) / 2)
below = eig3.jit(lambda t, u, v, p: u + 0.9999)


@eig3.jit
def far(t, u, v, p):
    return t - 2 * p[0]  # it ends half of the members


runaway = eig3.jit(lambda t, u, v, p: p[0] * u * u * u)


@eig3.jit
def springs(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[0] * u[j] - 0.1 * v[j]


@eig3.jit
def power(t, u, v, p, a):
    """A spring, and the integral of v^2."""
    a[0] = -p[0] * u[0]
    a[1] = v[0] * v[0]


def free(**options):
    return eig3.ensemble(linear_spring, (0, 10), 1.0, 0.0, **{"h": 0.01, "params": STIFFNESS, **options})


def assert_same_parts(solution, expected):
    assert_same(solution, expected)
    for i in (0, 127, 128, len(solution) - 1):
        np.testing.assert_array_equal(solution[i].t, expected[i].t)
        np.testing.assert_array_equal(solution[i].u, expected[i].u)
    assert (solution.first, solution.method) == (0, expected.method)
    assert solution.t.flags.writeable == expected.t.flags.writeable


@pytest.fixture(scope="module")
def pool():
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


@pytest.fixture(scope="module")
def client():
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with LocalCluster(**options) as cluster, Client(cluster) as client:
        yield client


@pytest.fixture
def threads():
    with ThreadPoolExecutor(2) as threads:
        yield threads


OTHER_PROCESSES = [pytest.param(name, marks=pytest.mark.system) for name in ("processes", "dask")]


@pytest.fixture(params=[*OTHER_PROCESSES, "threads"])
def executor(request):
    if request.param == "dask":
        return request.getfixturevalue("client").get_executor()
    return request.getfixturevalue("pool" if request.param == "processes" else "threads")


CASES = {
    "saved states": lambda **o: free(save_every=7, invariants={"energy": energy}, **o),
    "own steps": lambda **o: free(h=np.linspace(0.01, 0.2, MEMBERS), save_every=3, **o),
    "some diverge": lambda **o: eig3.ensemble(
        runaway, (0, 10), 1.0, 0.0, h=0.01, params=np.linspace(-1, 1, 300)[:, None], save_every=10, **o
    ),
    "vector form": lambda **o: eig3.ensemble(
        springs, (0, 10), np.ones((300, 2)), np.zeros(2), h=0.01, params=2.0, save_every=20, **o
    ),
    "tolerances in lanes": lambda **o: free(h=None, rtol=1e-6, method="rk5", events={"low": eig3.Event(below)}, **o),
    "own times": lambda **o: free(h=None, rtol=1e-5, method="rk5", save_every=2, **o),
    "events": lambda **o: free(events={"low": eig3.Event(below), "end": eig3.Event(far, terminal=True)}, **o),
    "one at a time": lambda **o: free(h=0.1, params=STIFFNESS[:200], method=eig3.CentralDifference(), **o),
}


@pytest.mark.parametrize("case", CASES)
def test_parts_have_the_bits_of_one_process(case, executor):
    assert_same_parts(CASES[case](executor=executor), CASES[case]())


def test_a_member_of_the_joined_solution_explains_why_it_diverged(threads):
    options = {"h": 0.01, "params": np.linspace(-1, 1, 300)[:, None]}
    solution = eig3.ensemble(runaway, (0, 10), 1.0, 0.0, executor=threads, **options)
    alone = eig3.integrate(runaway, (0, 10), 1.0, 0.0, h=0.01, params=options["params"][299], save_every=None)
    assert solution[299].status is eig3.Status.DIVERGED
    assert solution[299].explain() == alone.explain()


def test_each_part_of_reduce_knows_its_members(executor):
    def look(part):
        return part.first, len(part), part.params, part.u[:, -1]

    for parts in (free(reduce=look), free(reduce=look, executor=executor)):
        firsts, sizes, params, ends = zip(*parts, strict=True)
        assert firsts == tuple(range(0, MEMBERS, 128))
        assert sizes == (128,) * 7 + (104,)
        np.testing.assert_array_equal(np.concatenate(params), STIFFNESS)
        np.testing.assert_array_equal(np.concatenate(ends), free().u[:, -1])


def test_the_parts_of_a_reduced_solution_explain_too():
    def explanation(part):
        return part[0].explain()

    given = np.linspace(0.5, 1, 200)[:, None]
    texts = eig3.ensemble(runaway, (0, 10), 1.0, 0.0, h=0.01, params=given, reduce=explanation)
    for text, i in zip(texts, (0, 128), strict=True):
        alone = eig3.integrate(runaway, (0, 10), 1.0, 0.0, h=0.01, params=given[i], save_every=None)
        assert text == alone.explain()


def test_problems_with_integrals(threads):
    problem = eig3.Problem(
        name="power", rhs=power, z0={"work": 0.0}, u0=[1.0], v0=[0.0], params=(1.0,), t_span=(0.0, 10.0)
    )
    expected = problem.ensemble(h=0.01, params=STIFFNESS, save_every=10)
    assert_same_parts(problem.ensemble(h=0.01, params=STIFFNESS, save_every=10, executor=threads), expected)
    parts = problem.ensemble(
        h=0.01, params=STIFFNESS, save_every=10, executor=threads, reduce=lambda part: (part.u, part.z["work"])
    )
    u, work = (np.concatenate(each) for each in zip(*parts, strict=True))
    np.testing.assert_array_equal(u, expected.u)
    np.testing.assert_array_equal(work, expected.z["work"])


def test_the_integrals_of_a_member_that_diverges_end_with_it():
    problem = eig3.Problem(
        name="power", rhs=power, z0={"work": 0.0}, u0=[1.0], v0=[0.0], params=(1.0,), t_span=(0.0, 200.0)
    )
    stiffness = [[1.0], [-10.0]]  # the motion of the second overflows
    member = problem.ensemble(h=0.1, params=stiffness, save_every=7)[1]
    alone = problem.with_(params=stiffness[1]).integrate(h=0.1, save_every=7)
    assert member.status is eig3.Status.DIVERGED
    assert member.n_steps % 7 > 0
    for values, expected in ((member.t, alone.t), (member.u, alone.u), (member.z["work"], alone.z["work"])):
        np.testing.assert_allclose(values, expected, rtol=1e-11)  # some thousand operations of 1e-16


@pytest.mark.system
def test_a_worker_compiles_a_function_once(client):
    @eig3.jit
    def compiled_once(t, u, v, p):
        return -p[0] * u - 0.01 * v

    def known(part):
        functions = [x for x in gc.get_objects() if isinstance(x, Jitted) and x.__name__ == "compiled_once"]
        lanes = [lanes for function in functions if (lanes := remembered(function, "lanes"))]
        return os.getpid(), len(lanes), [id(compiled) for _, compiled in lanes[0].values()]

    options = {"h": 0.01, "params": STIFFNESS, "reduce": known, "executor": client.get_executor()}
    found = eig3.ensemble(compiled_once, (0, 10), 1.0, 0.0, **options)
    found += eig3.ensemble(compiled_once, (0, 20), 1.0, 0.0, **options)
    by_worker = {process: (count, *ids) for process, count, ids in found}
    assert all((count, *ids) == by_worker[process] for process, count, ids in found)
    assert all(count == 1 for count, *_ in by_worker.values())


def after_parts(monkeypatch, count, act):
    """Call ``act()`` when so many parts are stored."""
    stored = []

    def counted(put):
        def wrapped(results, part, value):
            put(results, part, value)
            stored.append(part.first)
            if len(stored) == count:
                act()

        return wrapped

    for results in (Joined, Listed):
        monkeypatch.setattr(results, "put", counted(results.put))
    return stored


SLOW = {"h": 1e-5, "params": np.linspace(1.0, 4.0, 2000)[:, None]}  # 16 parts of some 0.1 s each
KILLED = {
    "fixed steps": SLOW,
    "tolerances and events": {
        **{"h": None, "rtol": 1e-10, "method": "rk5", "params": SLOW["params"]},
        "events": {"low": eig3.Event(below), "end": eig3.Event(far, terminal=True)},
    },
}


@pytest.mark.system
@pytest.mark.parametrize("options", KILLED.values(), ids=KILLED)
def test_a_killed_worker_of_a_cluster_costs_nothing_but_time(options, client, monkeypatch):
    before = set(client.run(os.getpid).values())
    after_parts(monkeypatch, 2, lambda: os.kill(min(before), signal.SIGKILL))
    solution = free(**options, executor=client.get_executor())
    assert_same_parts(solution, free(**options))
    client.wait_for_workers(2)
    assert min(before) not in client.run(os.getpid).values()


@pytest.mark.system
def test_if_a_pool_breaks_the_rest_runs_here(monkeypatch):
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        after_parts(monkeypatch, 2, lambda: os.kill(next(iter(pool._processes)), signal.SIGKILL))
        solution = free(**SLOW, executor=pool)
        (note,) = solution.notes
        assert re.fullmatch(r"The executor broke, and \d+ of 16 parts ran in this process\.", note)
        solution.notes = ()
        assert_same_parts(solution, free(**SLOW))
        with pytest.warns(RuntimeWarning, match="The executor broke, and 8 of 8 parts ran in this process"):
            assert free(executor=pool, reduce=len) == free(reduce=len)  # the pool is still broken


class Lossy(ThreadPoolExecutor):
    """Loses the first parts that it gets, by an exception of its own or by cancelling them."""

    def __init__(self, losses):
        super().__init__(2)
        self.losses = losses

    def submit(self, *arguments):
        if not self.losses:
            return super().submit(*arguments)
        future, loss = Future(), self.losses.pop(0)
        if loss is None:
            future.cancel()
            future.set_running_or_notify_cancel()
        else:
            future.set_exception(loss)
        return future


def test_lost_parts_run_again():
    with Lossy([OSError("the worker died"), None, KeyboardInterrupt()]) as executor:
        assert_same_parts(free(executor=executor), free())


def test_a_part_that_is_lost_again_and_again_ends_the_run():
    with Lossy([OSError("the worker died")] * 100) as executor, pytest.raises(RuntimeError) as caught:
        free(executor=executor)
    assert re.match(r"the executor lost members \d+ to \d+ 3 times; .*OSError: the worker died$", str(caught.value))
    assert not caught.value.solution.success.any()


class TwoArgumentsError(Exception):
    """pickle fails to make it anew, as it does with many exceptions."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


def fail(part):
    if part.first == 256:
        raise ZeroDivisionError("a mean of nothing")
    return part.first


def fail_strangely(part):
    raise TwoArgumentsError(1, 2)


def test_an_exception_of_reduce_is_raised_once(executor):
    with pytest.raises(ZeroDivisionError, match="a mean of nothing") as caught:
        free(executor=executor, reduce=fail)
    assert "in fail" in str(caught.value.__cause__)  # the line of the user's function
    for first, value in zip(range(0, MEMBERS, 128), caught.value.solution, strict=True):
        assert value in (first, None)
    assert caught.value.solution[2] is None
    with pytest.raises(ZeroDivisionError) as caught:
        free(reduce=fail)
    assert caught.value.solution == [0, 128] + [None] * 6


@pytest.mark.system
def test_an_exception_that_cannot_travel_is_described(pool):
    with pytest.raises(RuntimeError, match="TwoArgumentsError: 1 and 2"):
        free(executor=pool, reduce=fail_strangely)


@eig3.jit
def refuses(t, u, v, p):
    if t > 5 and p[0] > 3:
        raise ValueError("p is too large")
    return -p[0] * u


def test_an_exception_of_rhs_keeps_what_is_finished(executor):
    with pytest.raises(ValueError, match="p is too large") as caught:
        eig3.ensemble(refuses, (0, 10), 1.0, 0.0, h=0.01, params=STIFFNESS, executor=executor)
    solution = caught.value.solution
    raised = [i for i, message in enumerate(solution.message) if message.startswith("The run raised ValueError")]
    assert raised
    assert set(solution.status) <= {eig3.Status.COMPLETED, eig3.Status.INTERRUPTED}
    assert not solution.success[raised].any()
    assert not solution.success[STIFFNESS[:, 0] > 3].any()


@pytest.mark.usefixtures("python_handler")
@pytest.mark.parametrize(("reduce", "has_executor"), [(None, True), (len, True), (len, False)])
def test_ctrl_c_keeps_the_finished_parts(reduce, has_executor, monkeypatch):
    stored = after_parts(monkeypatch, 2, lambda: os.kill(os.getpid(), signal.SIGINT))
    with ThreadPoolExecutor(1) as executor, pytest.raises(KeyboardInterrupt) as caught:
        free(**SLOW, reduce=reduce, executor=executor if has_executor else None)
    assert 2 <= len(stored) <= 3  # the next part may end together with the second
    if reduce:
        assert caught.value.solution == [128 if 128 * k in stored else None for k in range(16)]
    else:
        done = np.isin(np.arange(2000) // 128 * 128, stored)
        np.testing.assert_array_equal(caught.value.solution.success, done)
        assert set(caught.value.solution.status[~done]) == {eig3.Status.INTERRUPTED}
        assert set(caught.value.solution.message[~done]) == {"The run was interrupted before this member was returned."}


def test_memory_does_not_grow_with_the_members():
    """16 parts, of which only one is in memory, although the garbage collector does not run."""
    seen = []

    def peak(part):
        assert all(earlier() is None for earlier in seen)
        seen.append(weakref.ref(part))
        return part.u.max(), part.u.nbytes + part.v.nbytes

    options = {"h": 0.1, "save_every": 1, "reduce": peak}
    free(**options)  # which compiles
    seen.clear()
    gc.disable()
    tracemalloc.start()
    peaks, sizes = zip(*eig3.ensemble(linear_spring, (0, 500), 1.0, 0.0, **options, params=SLOW["params"]), strict=True)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    gc.enable()
    assert len(sizes) == 16
    assert sizes[0] == 128 * 5001 * 16
    assert most < 1.5 * sizes[0]  # with the states of a chunk, before they are saved
    # EIG-3 keeps the amplitude of a spring up to errors of (omega h)^3, at most 0.008.
    np.testing.assert_allclose(peaks, 1, rtol=0, atol=0.01)


def test_the_division_depends_on_the_ensemble_only():
    def sizes(m, n_steps, save_every=None, n=None):
        start = (1.0, 0.0) if n is None else (np.ones(n), np.zeros(n))
        rhs = linear_spring if n is None else springs
        members = check_members(rhs, (0, n_steps), *start, np.ones((m, 1)), 1.0)
        parts = parts_of(members, run_options(h=1.0, save_every=save_every))
        assert [part.first for part in parts] == list(np.cumsum([0, *map(len, parts)])[:-1])
        return [len(part) for part in parts]

    assert sizes(100, 10) == [100]
    assert sizes(300, 10) == [128, 128, 44]
    assert len(sizes(1_000_000, 10)) <= 128
    assert set(sizes(1_000_000, 10)[:-1]) == {62 * 128}
    assert set(sizes(13_000_000, 10)[:-1]) == {100_000 // 128 * 128}
    assert set(sizes(100_000, 9999, save_every=1)[:-1]) == {384}  # of which each has 160 kB of states: 61 MB in all
    assert set(sizes(40_000, 10, n=1000)[:-1]) == {256}  # of which each travels with 2001 numbers: 4 MB in all
    assert max(sizes(2000, 10**6, save_every=1)) == 128  # which is the least, whatever the size of its states


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"executor": "dask"},
            "executor must be a concurrent.futures.Executor, such as a ProcessPoolExecutor or .*'dask'",
        ),
        ({"reduce": 3}, "reduce must be a function of an EnsembleSolution, not 3"),
    ],
)
def test_bad_arguments(options, message):
    with pytest.raises(TypeError, match=message):
        free(**options)


@pytest.mark.system
def test_a_client_is_no_executor(client):
    with pytest.raises(TypeError, match=r"pass client\.get_executor\(\), not the client"):
        free(executor=client)


@pytest.mark.system
def test_what_cannot_be_pickled_is_named(pool):
    lock = threading.Lock()
    with pytest.raises(TypeError, match=r"^reduce must be picklable, .*lock"):
        free(executor=pool, reduce=lambda part: lock)
    with pytest.raises(TypeError, match=r"^What reduce returns must be picklable, .*generator"):
        free(executor=pool, reduce=iter_members)


def iter_members(part):
    return (member for member in part)


def test_progress_counts_members(threads, capsys):
    free(executor=threads, progress=True)
    assert "1.00k/1.00k" in capsys.readouterr().err


def test_a_pickled_solution_has_each_time_once():
    solution = free(save_every=1)
    data = pickle.dumps(solution)
    copy = pickle.loads(data)
    assert_same_parts(copy, solution)
    assert len(data) < 1.1 * (solution.u.nbytes + solution.v.nbytes)


def test_a_form_is_itself_after_pickling():
    assert [pickle.loads(pickle.dumps(form)) for form in (SCALAR, VECTOR)] == [SCALAR, VECTOR]


@pytest.mark.system
def test_the_example_of_the_readme_is_a_script(tmp_path):
    """`test_readme` does not run what the script does only where it is the main module."""
    (example,) = (text for _, text in BLOCKS["eig3/ensembles/README.md"] if "LocalCluster" in text)
    example = example.replace("100_000", "5_000")  # some parts of 128 members or more; all of them take ten seconds
    namespace = {}
    exec(example, namespace)
    start = np.random.default_rng(0).uniform(-2, 2, (2, 5_000))
    solution = eig3.ensemble(namespace["double_well"], (0, 100), *start, h=0.01)
    count = np.count_nonzero(solution.u[:, -1] > 0)
    assert output(tmp_path / "example.py", example).decode() == f"{count} of 5000 end in the right well\n"
