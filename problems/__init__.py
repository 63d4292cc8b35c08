"""Problems, one a file."""

from .damped_bar import damped_bar
from .elastic_bar import elastic_bar
from .hardening_chain import hardening_chain
from .hardening_spring import hardening_spring
from .single_dof import single_dof
from .softening_spring import softening_spring
from .spring_pendulum import spring_pendulum

__all__ = [
    "damped_bar",
    "elastic_bar",
    "hardening_chain",
    "hardening_spring",
    "single_dof",
    "softening_spring",
    "spring_pendulum",
]
