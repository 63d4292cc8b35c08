"""The records and their registry."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import pytest

import eig3
from eig3.cli import main
from eig3.command_line import method_name
from eig3.functions.checks import check_method

from .conftest import harmonic


def test_names_are_those_of_the_design():
    names = ["eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3", "rk5", "rk8", "rkn12", "bm6"]
    assert list(eig3.METHODS) == [*names, *(f"eig{grade}" for grade in range(4, 14)), "langevin"]


def test_a_variant_does_not_take_the_name_of_its_base():
    @dataclass(frozen=True)
    class Damped(eig3.EIG3):
        alpha: float = 1.3

    assert eig3.METHODS["eig3"] is eig3.EIG3
    assert Damped().settings == (1.3, 0.5)


def test_a_name_is_not_taken_twice():
    with pytest.raises(ValueError, match=r"name 'rk2' is taken by RK2; give .*Other another name"):

        class Other(eig3.Method):
            name: ClassVar[str] = "RK2"

    assert eig3.METHODS["rk2"] is eig3.RK2


def test_a_kernel_file_that_lacks_a_name_is_refused():
    @dataclass(frozen=True)
    class Incomplete(eig3.Method):
        kernel: ClassVar[str] = "eig3.kernels.loops.march"

    with pytest.raises(TypeError, match=r"kernel 'eig3.kernels.loops.march' must define ROWS, step:"):
        _ = Incomplete().formulas


def test_a_record_whose_options_may_change_is_refused():
    """Runs with equal records share compiled code."""

    class Changing(eig3.Method):
        def __init__(self, alpha):
            self.alpha = alpha

    with pytest.raises(AttributeError, match=r"^Changing cannot set 'alpha': .* @dataclass\(frozen=True\)\.$"):
        Changing(1.0)


def test_every_record_is_hashable_and_describes_itself():
    for record in eig3.METHODS.values():
        method = record()
        assert hash(method) == hash(record())
        assert method == record()
        assert repr(method).startswith(type(method).__name__)
        assert method.order in range(2, 13)


def test_a_record_has_the_evaluations_of_its_kernel():
    class Variant(eig3.Method):
        kernel = "eig3.kernels.methods.rk4"
        label = "variant"
        order = 4

    assert (Variant().evaluations, Variant().is_implicit) == (4, False)
    assert "4 evaluations a step" in eig3.stability.explain(Variant())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: eig3.EIG3(alpha=10**400), r"^alpha must be a finite number, not 1000.*\.\.\.\.$"),
        (lambda: eig3.EIG3(beta=-(10**400)), r"^beta must be a finite number, not -1000.*\.\.\.\.$"),
        (lambda: eig3.EIG3(alpha=10**5000), r"^alpha must be a finite number, not an integer of thousands of"),
        (lambda: eig3.CentralDifference(tol=10**400), r"^tol must be a number between 0 and 1, not 1000"),
        (lambda: eig3.CentralDifference(max_iterations=10**400), r"^max_iterations must be a whole number of at least"),
    ],
)
def test_numbers_that_no_float_can_hold_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("label", "record"),
    [
        ("EIG-3", eig3.EIG3()),
        ("EIG-9", eig3.EIG(9)),
        ("eig 13", eig3.EIG(13)),
        ("RK8", eig3.RK8()),
        (" bm6 ", eig3.BM6()),
        ("CD, Newton", eig3.CentralDifference(solver="newton")),
        ("CD N.", eig3.CentralDifference(solver="newton")),
        ("cd fixed-point", eig3.CentralDifference(solver="fixed-point")),
        ("CD f.p.", eig3.CentralDifference(solver="fixed-point")),
    ],
)
def test_the_labels_that_tables_print_are_names(label, record):
    assert check_method(label) == record


def test_every_label_is_a_name():
    for make in eig3.METHODS.values():
        assert check_method(make().label) == make()


@pytest.mark.parametrize(
    "label", ["RK8 tol.", "RK8, tolerances", "rk8 tolerances", "RK8 with tolerances", "RK8, rtol 1.0e-06"]
)
def test_a_label_with_tolerances_is_a_name_with_rtol_and_is_refused_with_h(label):
    assert eig3.integrate(harmonic, (0, 1), 1.0, 0.0, rtol=1e-3, method=label).method == eig3.RK8()
    with pytest.raises(ValueError, match=r"belongs to a run with tolerances: give rtol in place of h, or method='rk8'"):
        eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=0.1, method=label)


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("rk45", {"rk4", "rk5"}),
        ("EIG", {"eig7", "eig8", "eig9"}),
        ("eig14", {"eig4"}),
        ("RK-44", {"rk4"}),
        ("bm", {"bm6"}),
        ("DOP853", {"rk8"}),
        ("velocity verlet", {"cd"}),
    ],
)
def test_an_unknown_name_is_answered_by_the_nearest_ones(text, near):
    with pytest.raises(ValueError, match=rf"^method must be one of 'eig3', .*, not '{text}': did you mean ") as caught:
        check_method(text)
    assert near <= set(re.findall(r"'(\w+)'", str(caught.value).partition("did you mean")[2]))


@pytest.mark.parametrize("text", ["", ".", "tol.", "newmark", "EIG-3 and more", 3, b"eig3"])
def test_what_is_near_no_name_is_refused(text):
    with pytest.raises(ValueError, match=r"^method must be one of 'eig3', .* or a record such as EIG3\(\), not "):
        check_method(text)


def test_the_label_of_a_users_method_is_a_name():
    class Halved(eig3.RK2):
        name: ClassVar[str] = "half-rk2"
        label: ClassVar[str] = "RK2 (halved)"

    try:
        assert type(check_method("RK2 (halved)")) is type(check_method("HALF-RK2")) is Halved
        assert check_method("RK2") == eig3.RK2()
    finally:
        del eig3.METHODS["half-rk2"]


def test_commands_take_labels(capsys):
    assert main(["run", "duffing", "--method", "EIG-3", "--h", "0.1", "--t-end", "1"]) == 0
    assert method_name("EIG-9") == "eig9"
    assert method_name("CD") == "cd"
    assert method_name("RK8 tol.") == "RK8 tol."


@pytest.mark.parametrize("method", [eig3.Method, eig3.Method()])
def test_the_base_of_all_records_is_no_method(method):
    with pytest.raises(ValueError, match=r"^method must be one of 'eig3', .* or a record such as EIG3\(\), not <"):
        eig3.integrate(None, (0, 1), 1.0, 0.0, h=0.1, method=method)


def test_without_the_compiler_the_import_says_what_to_do():
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", "import eig3"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert result.stderr.splitlines()[-1] == (
        "ImportError: eig3 runs compiled code only: unset NUMBA_DISABLE_JIT, which turns Numba's compiler off."
    )
