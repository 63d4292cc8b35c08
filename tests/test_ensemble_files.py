"""Ensembles in files and directories, ensembles that are cancelled, and members that are longer than others."""

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import eig3

from .conftest import oscillator, position, velocity

MEMBERS = 300
PARAMS = np.column_stack([np.linspace(1.0, 4.0, MEMBERS), np.full(MEMBERS, 0.05)])
START = oscillator, (0.0, 10.0), 1.0, 0.0

WRITER = """\
import sys, time, numpy as np, eig3
from tests.conftest import oscillator
from tests.test_ensemble_files import PARAMS, START

eig3.ensemble(*START, h=1e-5, params=PARAMS, threads=1, save_to=sys.argv[1])
"""


def test_the_finished_members_outlive_their_process(tmp_path):
    place = tmp_path / "run"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(place)])
    until = time.monotonic() + 60
    while not [*place.glob("part-*.npz")] and time.monotonic() < until:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    found = eig3.load(place)
    done = found.status == eig3.Status.COMPLETED
    assert len(found) == MEMBERS
    assert done[:128].all()
    assert not done.all()
    assert (found.status[~done] == eig3.Status.INTERRUPTED).all()
    assert [len(member.t) for member in found] == [2 if is_done else 1 for is_done in done]
    again = eig3.ensemble(*START, h=1e-5, params=PARAMS[:1])
    np.testing.assert_array_equal(found[0].u, again[0].u)


@pytest.mark.parametrize("options", [{"h": 1e-5}, {"rtol": 1e-13, "method": "rk5"}, {"h": 1e-5, "reduce": len}])
def test_cancel_ends_an_ensemble(options):
    cancel = threading.Event()
    threading.Timer(0.3, cancel.set).start()
    begin = time.monotonic()
    long = oscillator, (0.0, 1e7 if "rtol" in options else 1e3), 1.0, 0.0
    found = eig3.ensemble(*long, params=PARAMS, cancel=cancel, **options)
    assert time.monotonic() - begin < 60  # the whole ensemble takes minutes
    if "reduce" in options:
        assert found[-1] is None
        return
    ended = found.status == eig3.Status.INTERRUPTED
    assert ended.any()
    member = found[int(np.argmax(ended))]
    assert np.isfinite(member.u).all()


def test_an_ensemble_that_is_cancelled_before_has_its_start_only():
    cancel = threading.Event()
    cancel.set()
    found = eig3.ensemble(*START, h=0.01, params=PARAMS, cancel=cancel)
    assert (found.status == eig3.Status.INTERRUPTED).all()
    np.testing.assert_array_equal(found.u[:, 0], 1.0)
    with pytest.raises(TypeError, match="cancel must"):
        eig3.ensemble(*START, h=0.01, params=PARAMS, cancel=True)


def test_members_have_as_many_rows_as_they_have_steps():
    """With tolerances, the stiffest member has the most states."""
    found = eig3.ensemble(*START, rtol=1e-6, params=PARAMS[::50], save_every=1)
    lengths = [len(member.t) for member in found]
    assert lengths == (found.n_steps + 1).tolist()
    assert found.u.shape[1] == max(lengths) > min(lengths)
    assert [np.isfinite(row).sum() for row in found.u] == lengths
    assert all((member.steps[1:] > 0).all() and member.at(5.0)[0] for member in found)


def test_a_loaded_ensemble_takes_a_right_hand_side(tmp_path):
    found = eig3.ensemble(*START, h=0.01, params=PARAMS[:5], save_every=5, events={"turn": eig3.Event(velocity)})
    path = found.save(tmp_path / "file")
    loaded = eig3.load(path, rhs=oscillator)
    assert loaded[2].at(1.234) == found[2].at(1.234)
    np.testing.assert_array_equal(loaded.events["turn"].first, found.events["turn"].first)
    with pytest.raises(ValueError, match="this ensemble cannot be extended: it was copied, loaded or is a part"):
        loaded.extend(11.0)
    with pytest.raises(ValueError, match="events is for single runs"):
        eig3.load(path, events={"turn": eig3.Event(velocity)})


def test_what_extend_does_not_take():
    found = eig3.ensemble(*START, h=0.01, params=PARAMS[:3])
    with pytest.raises(ValueError, match=r"t_end must be a whole number of steps h = .*; take t_end=11.0"):
        found.extend(11.003)
    with pytest.raises(ValueError, match="t_end must be later than the end of the run at t = 10, not 9"):
        found.extend(9.0)
    with pytest.raises(ValueError, match="t_eval belongs to a run with t_eval"):
        found.extend(11.0, t_eval=[10.5])


@pytest.mark.parametrize("name", ["u", "status", "first", "n_steps"])
def test_damaged_ensembles_are_refused(name, tmp_path):
    import json

    path = eig3.ensemble(*START, h=0.01, params=PARAMS[:3]).save(tmp_path / "file")
    arrays = dict(np.load(path))
    record = json.loads(str(arrays["eig3"]))
    record["solution"][name] = "of another type"
    np.savez(path, **arrays | {"eig3": np.array(json.dumps(record))})
    with pytest.raises(ValueError, match="is damaged: take a copy of it, or run again"):
        eig3.load(path)


def test_first_passages_in_bounded_memory():
    """u = cos(omega t) passes zero first at pi / (2 omega), to the error of RK4: (omega h)^4 / 100 of the time."""
    omega = np.linspace(1.0, 4.0, 20_000)
    params = np.column_stack([omega, np.zeros_like(omega)])
    events = {"zero": eig3.Event(position, terminal=True)}

    def first(part):
        return part.events["zero"].first

    found = eig3.ensemble(*START, h=0.01, method="rk4", params=params, events=events, reduce=first)
    assert len(found) == 79  # parts of 256 members
    np.testing.assert_allclose(np.concatenate(found), np.pi / 2 / omega, rtol=1e-7)
