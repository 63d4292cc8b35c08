"""Runs that go on: `extend` gives the numbers of one run over the whole span, to the last bit."""

import copy
import pickle
import threading

import numpy as np
import pytest

import eig3

from .conftest import assert_same, energy, oscillator
from .going_on import SCALAR, SCALAR_WITHOUT_V, VECTOR, VECTOR_WITHOUT_V, H, forces
from .test_resume import After


def integrate(system, t_end, **options):
    start = system["rhs"], (1.0, t_end), system["u0"], system["v0"]
    options = options if "rtol" in options else {"h": H, **options}
    return eig3.integrate(*start, params=system["params"], **options)


@pytest.mark.parametrize("form", ["scalar", "vector"])
@pytest.mark.parametrize(
    ("method", "save_every"),
    [("eig3", 1), ("eig3", 7), ("eig3", None), ("cd", 7), ("ab3", 7), ("eig9", 7), ("rk8", None), ("bm6", 1)],
)
def test_an_extended_run_is_one_run(method, form, save_every):
    system = SCALAR if form == "scalar" else VECTOR
    if method == "bm6":
        system = SCALAR_WITHOUT_V if form == "scalar" else VECTOR_WITHOUT_V
    options = {"method": method, "save_every": save_every}
    # Ends in the first steps, which another method may take, and at and between the rows of save_every.
    first = integrate(system, 1.0 + 3 * H, **options)
    before = first.t.copy(), first.u.copy()
    extended = first.extend(1.0 + 70 * H).extend(1.0 + 71 * H).extend(1.0 + 200 * H)
    assert_same(extended, integrate(system, 1.0 + 200 * H, **options))
    np.testing.assert_array_equal(first.t, before[0])
    np.testing.assert_array_equal(first.u, before[1])


@pytest.mark.parametrize("save_every", [1, 7, None])
def test_invariants_and_outputs_go_on(save_every):
    options = {"invariants": {"energy": energy}, "outputs": {"f": (forces, 2)}, "save_every": save_every}
    first = integrate(SCALAR, 1.0 + 100 * H, **options)
    whole = integrate(SCALAR, 1.0 + 1000 * H, **options)
    assert_same(first.extend(1.0 + 1000 * H), whole)
    assert_same(first.extend(1.0 + 500 * H).extend(1.0 + 1000 * H), whole)  # `first` is still at its own end


def test_an_interrupted_run_goes_on_from_where_it_stopped():
    cancel = threading.Event()
    cancel.set()
    none = integrate(SCALAR, 1.0 + 100 * H, cancel=cancel)
    assert (none.status, none.n_steps) == (eig3.Status.INTERRUPTED, 0)
    assert_same(none.extend(1.0 + 100 * H), integrate(SCALAR, 1.0 + 100 * H))
    stopped = integrate(SCALAR, 1.0 + 100 * H).extend(1.0 + 200 * H, cancel=cancel)
    assert (stopped.status, stopped.n_steps) == (eig3.Status.INTERRUPTED, 100)
    assert_same(stopped.extend(1.0 + 200 * H), integrate(SCALAR, 1.0 + 200 * H))
    with pytest.raises(eig3.IntegrationError) as caught:
        stopped.extend(1.0 + 200 * H, cancel=cancel, raise_on_failure=True)
    assert caught.value.solution.n_steps == 100


#: A spring, on which a force acts from t = p[0] on.
pushed = eig3.jit(lambda t, u, v, p: (1.0 if t >= p[0] else 0.0) - u - 0.1 * v)


STARTS = {"rest": (0.0, 0.0, 0.0), "silence": (0.0, 0.0, 2.0), "displaced": (1.0, 0.0, 0.0), "pushed": (0.0, 1.0, 9.0)}


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("method", ["rk5", "rk8", "eig3"])
def test_an_extended_run_with_tolerances_is_one_run(method, start):
    """Also from rest, where the first span is shorter than a unit of time, and where it is shorter than a step."""
    u0, v0, begin = STARTS[start]
    for save_every in (1, 7, None):
        options = {"rtol": 1e-6, "method": method, "save_every": save_every, "params": begin}
        options |= {"invariants": {"energy": energy}, "outputs": {"f": (forces, 2)}}
        whole = eig3.integrate(pushed, (0, 5), u0, v0, **options)
        for first in (1e-9, 1e-3, 0.3, 0.9, 1.7):
            run = eig3.integrate(pushed, (0, first), u0, v0, **options)
            before = run.t.copy()
            extended = run.extend(first + 0.1).extend(4.0).extend(5.0)
            assert_same(extended, whole)
            np.testing.assert_array_equal(run.t, before)


@pytest.mark.parametrize("save_every", [1, 7, None])
def test_an_interrupted_run_with_tolerances_goes_on(save_every, monkeypatch):
    """The last state of the interrupted run is not in the new one if it was saved only because it was the last."""
    monkeypatch.setattr("eig3.stepping.slices._SECONDS", 1e-12)  # slices of one step
    monkeypatch.setattr("eig3.stepping.slices._FIRST_SECONDS", 1e-12)
    options = {"rtol": 1e-6, "params": 0.0, "save_every": save_every}
    whole = eig3.integrate(pushed, (0, 100), 2.0, 0.0, **options)
    stopped = eig3.integrate(pushed, (0, 100), 2.0, 0.0, **options, cancel=After(3))
    assert stopped.status is eig3.Status.INTERRUPTED
    assert 0 < stopped.n_steps < whole.n_steps
    assert_same(stopped.extend(100), whole)


@pytest.mark.parametrize(
    ("t_end", "nearest"),
    [(2.01, 2 + H), (2 + 1.4 * H, 2 + H), (2 + 1.6 * H, 2 + 2 * H), (2.0, 2 + H), (1.5, 2 + H), (-1e3, 2 + H)],
)
def test_the_new_end_is_a_whole_number_of_steps_later(t_end, nearest):
    run = integrate(SCALAR, 2.0)
    with pytest.raises(ValueError, match=rf"t_end must be a whole number of steps .* take t_end={nearest!r}\.$"):
        run.extend(t_end)
    assert run.extend(nearest).t[-1] == nearest


def test_round_off_in_the_new_end_is_accepted():
    run = integrate(SCALAR, 2.0, h=0.1)
    extended = run.extend(3.3)
    assert extended.t[-1] == 3.3
    assert extended.n_steps == 23
    assert extended.t[10] == 1.0 + 10 * extended.h  # no longer the given end of the first run


@pytest.mark.parametrize("t_end", [np.inf, np.nan, "3", [3.0]])
def test_the_new_end_must_be_a_finite_number(t_end):
    with pytest.raises((TypeError, ValueError), match="t_end must be"):
        integrate(SCALAR, 2.0).extend(t_end)


def test_what_cannot_be_extended_says_why():
    run = integrate(SCALAR, 2.0)
    lost = [copy.copy(run), copy.deepcopy(run), pickle.loads(pickle.dumps(run))]
    lost.append(eig3.ensemble(oscillator, (0, 1), [1.0, 2.0], 0.0, h=0.1, params=[[2.0, 0.1]])[1])
    for solution in lost:
        with pytest.raises(ValueError, match="this solution cannot be extended: it was copied or pickled"):
            solution.extend(3.0)
    with pytest.raises(ValueError, match="t_eval belongs to a run with t_eval"):
        run.extend(3.0, t_eval=[2.5])
    with pytest.raises(ValueError, match=r"t_eval must begin after the end of the run at t = 2\.0"):
        integrate(SCALAR, 2.0, t_eval=[1.5]).extend(3.0, t_eval=[2.0])


@pytest.mark.parametrize("options", [{}, {"rtol": 1e-6}], ids=["fixed", "tolerances"])
@pytest.mark.parametrize("form", [SCALAR, VECTOR], ids=["scalar", "vector"])
def test_a_run_with_wanted_times_goes_on(options, form, tmp_path):
    first, further = [1.0, 1.3, 1.9], [2.1, 2.5, 3.0]
    whole = integrate(form, 3.0, t_eval=[*first, *further], **options)
    run = integrate(form, 2.0, t_eval=first, **options, save_to=tmp_path / "run")
    np.testing.assert_array_equal(eig3.load(tmp_path / "run").u, run.u)
    for solution in (run, eig3.load(run.save(tmp_path / "file"), rhs=form["rhs"])):
        assert_same(solution.extend(3.0, t_eval=further), whole)
        assert_same(solution.extend(3.0, t_eval=further, save_to=tmp_path / str(id(solution))), whole)
    assert len(run.extend(3.0).t) == 3


@eig3.jit
def failing(t, u, v, p):
    if t > 1.5:
        raise ValueError("beyond the table")
    return -u


def test_a_run_that_raised_cannot_be_extended():
    with pytest.raises(ValueError, match="beyond the table") as caught:
        integrate(SCALAR | {"rhs": failing}, 2.0)
    with pytest.raises(ValueError, match="ended with an exception"):
        caught.value.solution.extend(3.0)
    with pytest.raises(ValueError, match="beyond the table") as caught:
        integrate(SCALAR | {"rhs": failing}, 1.0 + H).extend(3.0)
    assert caught.value.solution.t[-1] == 1.5 + H  # the step from t = 1.5 to here evaluates rhs at t = 1.5
