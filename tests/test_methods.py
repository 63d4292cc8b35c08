"""The records and their registry."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

import eig3


def test_names_are_those_of_the_design():
    assert list(eig3.METHODS) == ["eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3"]


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
        kernel: ClassVar[str] = "eig3.kernels.march"

    with pytest.raises(TypeError, match=r"kernel 'eig3.kernels.march' must define ROWS, step_scalar, step_vector"):
        _ = Incomplete().formulas


def test_every_record_is_hashable_and_describes_itself():
    for record in eig3.METHODS.values():
        method = record()
        assert hash(method) == hash(record())
        assert method == record()
        assert repr(method).startswith(record.__name__)
        assert method.order in (2, 3, 4)
