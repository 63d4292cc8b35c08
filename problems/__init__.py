"""Problems, one a file."""

from .hardening_spring import hardening_spring
from .single_dof import single_dof
from .softening_spring import softening_spring
from .spring_pendulum import spring_pendulum

__all__ = ["hardening_spring", "single_dof", "softening_spring", "spring_pendulum"]
