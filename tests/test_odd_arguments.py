"""Arguments of odd types and sizes: each has its plain meaning, or is refused in a sentence before anything runs."""

import numpy as np
import pytest

import eig3

from .conftest import position, spring

RUN = {"rhs": spring, "t_span": (0, 1), "u0": 1.0, "v0": 0.0, "params": (1.0,), "h": 0.1}
NEVER = 10**30  # beyond any count of 64 bits


@eig3.jit
def three(t, u, v, p, out):
    out[0], out[1], out[2] = u, v, u * v


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        *(({"events": {"zero": eig3.Event(position, apply=x)}}, TypeError, "apply of") for x in (0, "", [])),
        *(({"method": x}, ValueError, "method must be one of") for x in ("", 0, [])),
        *(
            ({name: x}, TypeError, f"{name} must be True or False")
            for name in ("inline", "progress")
            for x in (1, "no")
        ),
        ({"raise_on_failure": "False"}, TypeError, "raise_on_failure must be True or False"),
        ({"save_every": np.timedelta64(5, "s")}, ValueError, "save_every must be a whole number"),
    ],
)
@pytest.mark.parametrize("control", [{}, {"h": None, "rtol": 1e-3}])
def test_integrate_refuses(change, error, message, control):
    with pytest.raises(error, match=message):
        eig3.integrate(**{**RUN, **control, **change})


@pytest.mark.parametrize("direction", [1 + 0j, True, "1", np.timedelta64(1, "s"), None, 2])
def test_events_refuse_other_directions(direction):
    with pytest.raises(ValueError, match="direction must be -1, 0 or 1"):
        eig3.Event(position, direction=direction)


def test_a_count_that_no_run_reaches_saves_the_two_ends():
    for control in ({"h": 0.1}, {"h": None, "rtol": 1e-3}):
        assert len(eig3.integrate(**{**RUN, **control, "save_every": NEVER}).t) == 2
    members = eig3.ensemble(**{**RUN, "u0": np.ones(3), "save_every": NEVER})
    assert members.u.shape == (3, 2)


def test_the_number_of_values_may_be_a_small_integer_of_numpy():
    """Some 200 of them are beyond 255, the largest of these numbers, when they are counted with others."""

    @eig3.jit
    def many(t, u, v, p, out):
        for j in range(200):
            out[j] = j * u

    outputs = {"many": (many, np.uint8(200)), "three": (three, np.uint8(3)), "again": (many, np.uint8(200))}
    solution = eig3.integrate(**RUN, outputs=outputs)
    assert solution.outputs["many"].shape == (11, 200)
    assert solution.outputs["many"][0, 199] == 199.0
    assert eig3.ensemble(**{**RUN, "u0": np.ones(3)}, outputs=outputs).outputs["many"].shape == (3, 2, 200)


@pytest.mark.parametrize("k", [10**15, NEVER])
def test_values_that_fit_into_no_memory_are_refused(k):
    with pytest.raises(MemoryError, match=r"^outputs\['three'\] has .* values, which do not fit into memory"):
        eig3.integrate(**RUN, outputs={"three": (three, k)})


class Soon:
    """A `cancel` that is set when it is asked for the third time."""

    asked = 0

    def is_set(self):
        self.asked += 1
        return self.asked > 2


def test_a_stepper_may_go_on_until_it_is_cancelled():
    stepper = eig3.Stepper(spring, 1.0, 0.0, h=0.1, params=(1.0,))
    for _ in range(2):
        assert stepper.advance(NEVER, cancel=Soon()) > 0


@pytest.mark.parametrize("times", ["1", ["0.5"], np.ma.masked_array([0.5, 0.7], [True, False]), 0.5j, None])
def test_at_takes_real_times(times):
    with pytest.raises(TypeError, match="t must be made of real numbers"):
        eig3.integrate(**RUN).at(times)


@pytest.mark.parametrize("t_end", [0, -1, np.nan, 9.99, "20"])
def test_the_end_of_an_animation_is_not_before_that_of_the_solution(tmp_path, t_end):
    problem = eig3.problems.duffing().with_(t_span=(0, 10))
    with pytest.raises((TypeError, ValueError), match="t_end must be"):
        problem.animate(problem.integrate(h=0.1), tmp_path / "film.gif", t_end=t_end)
