"""Contact of spheres with friction, after Hertz and Mindlin."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.frictional_contact import FrictionalContact
from .touching import Touching

_LOSS = 2 * math.sqrt(5 / 6)


@element
def tension(r, rate, radius, mass, contact_distance, plane_modulus, loss):
    d = max(0.0, contact_distance - r)
    width = math.sqrt(radius * d)
    push = 4 / 3 * plane_modulus * width * d - loss * math.sqrt(2 * plane_modulus * width * mass) * rate
    return -max(0.0, push)


@element
def shear_stiffness(r, radius, contact_distance, shear_modulus):
    return 8 * shear_modulus * math.sqrt(radius * max(0.0, contact_distance - r))


@element
def shear_damping(r, radius, mass, contact_distance, shear_modulus, loss):
    return loss * math.sqrt(8 * shear_modulus * math.sqrt(radius * max(0.0, contact_distance - r)) * mass)


def damping_ratio(restitution: float) -> float:
    """Return the damping ratio z with which a contact of Hertz that never pulls has a restitution, above 0 and up to 1.

    With q = d^(5/4), the speed of the indentation d as a function of q equals the speed of a linear oscillator: O.
    Antypov and J. A. Elliott, EPL 94 (2011). The contact ends where its force is 0, while d is still positive: T.
    Schwager and T. Poeschel, Granular Matter 9 (2007). So -ln(restitution) = 2 z arccos(z) / sqrt(1 - z^2), which grows
    with z. Above z = 1, the numerator and the denominator are imaginary.
    """
    low, high = 0.0, 1 / math.sqrt(restitution)
    while low < (ratio := (low + high) / 2) < high:
        angle = cmath.acos(ratio)
        decay = 2 * ratio * (angle / cmath.sin(angle) if angle else 1.0).real
        low, high = (ratio, high) if decay <= -math.log(restitution) else (low, ratio)
    return low


@dataclass(frozen=True, eq=False)
class HertzMindlin(FrictionalContact, Touching):
    """Contacts of elastic spheres of one material with friction, after Hertz and Mindlin.

    Formula: with the indentation d of two spheres with the radii R1 and R2, the effective radius R = R1 R2 / (R1 + R2)
    and the effective mass m, the normal force is 4/3 E* sqrt(R d) d + c_n d', or 0 if this is negative. A spring along
    the surfaces has Mindlin's stiffness k_t = 8 G* sqrt(R d): its force grows with k_t times the tangential velocity
    and falls with k_t. With its damping c_t, it is at most friction times the normal force. E* = E / (2 (1 - nu^2)), G*
    = E / (4 (2 - nu) (1 + nu)). A damping is c = 2 sqrt(5/6) z sqrt(k m), with k_t or k_n = 2 E* sqrt(R d). The damping
    ratio z gives the restitution at every speed: see `damping_ratio`.

    Add it to one array of points, or between points and fixed points with ``others=``. Give the masses an inertia, or
    they do not spin. In two dimensions the points are spheres whose centres stay in a plane.

    Parameters
    ----------
    E : float
        Young's modulus, Pa.
    nu : float
        Poisson's ratio, from 0 to 0.5.
    friction : float
        Coefficient of friction.
    restitution : float
        Coefficient of restitution of a normal impact, above 0 and up to 1.
    contact_distance : float or array_like
        The distance at which two points touch: the diameter of each point, or between points and fixed points the sum
        of the two radii, m. Give it, or the radii.
    radii : float or array_like
        In place of contact_distance: the radius of each point, or of all, m. A pair touches at the sum of its radii,
        and a point and a fixed one at the sum of its radius and wall_radius.
    wall_radius : float, optional
        The radius of fixed points, m; half of the least contact distance if not given.

    Raises
    ------
    TypeError, ValueError
        For a parameter out of its range, and without one of contact_distance and radii.

    Notes
    -----
    Other codes: LAMMPS ``pair_style granular`` with ``hertz/material E e nu tangential mindlin_rescale/force NULL
    x_gamma mu damping coeff_restitution limit_damping``: the elastic forces and the limit of friction are equal. With
    ``mindlin/force`` the spring is not rescaled where the contact radius shrinks. LAMMPS has z = -ln e / sqrt(pi^2 +
    ln^2 e), which neglects ``limit_damping`` (2 % less at e = 0.9), the tangential damping x_gamma c_n, and the radius
    as the arm of a spin, which is here the distance to the contact.

    Not included: rolling and twisting friction, cohesion (``jkr``, ``dmt``), several materials in one effect, and walls
    other than spheres.

    The order of every method is at most 2 in a run with this effect: a spring advances once a step, by the trapezoidal
    rule. EIG-3, ``rk2`` and methods of a higher order keep order 2 while no contact begins, ends, or changes between
    stick and slip. The begin of a contact causes an error of the order h^(3/2) in its spring. The turn of the
    indentation from growth to fall causes an error of the order h^2, which depends on the place of the turn in its
    step. A spring vibrates at up to 1.7 times the frequency of the normal contact; `Problem.critical_step` includes it.
    """

    E: float
    nu: float
    friction: float
    restitution: float = 1.0
    contact_distance: ArrayLike | None = field(default=None, kw_only=True)
    radii: ArrayLike | None = field(default=None, kw_only=True)
    wall_radius: float | None = field(default=None, kw_only=True)
    plane_modulus: float = field(init=False, default=0.0)
    shear_modulus: float = field(init=False, default=0.0)
    loss: float = field(init=False, default=0.0)

    nonnegative = ("nu", "contact_distance", "friction")
    source = (
        "Hertz (1881); Mindlin (1949), Mindlin and Deresiewicz (1953); Di Renzo and Di Maio (2004); damping of Tsuji "
        "et al. (1992), and its ratio by Antypov and Elliott (2011) and Schwager and Poeschel (2007)"
    )

    def __post_init__(self) -> None:
        self.touch()
        if self.wall_radius is None:
            object.__setattr__(self, "wall_radius", float(np.min(self._reals("contact_distance"))) / 2)
        super().__post_init__()
        for name in ("E", "nu", "friction", "restitution", "wall_radius"):
            self.require(np.ndim(getattr(self, name)) == 0, f"{name} must be one number")
        self.require(self._reals("E") > 0, "E must be positive")
        self.require(self._reals("nu") <= 0.5, "nu must not be above 0.5")
        e, radius = self._reals("restitution"), self._reals("wall_radius")
        self.require((e > 0) & (e <= 1), "restitution must be above 0 and at most 1")
        most = np.min(self._reals("contact_distance")) if self.radii is None else np.inf
        self.require((radius > 0) & (radius <= most), "wall_radius must be positive and at most the contact_distance")
        computed = {
            "plane_modulus": self.E / (2 * (1 - self.nu**2)),
            "shear_modulus": self.E / (4 * (2 - self.nu) * (1 + self.nu)),
            "loss": _LOSS * damping_ratio(float(e)),
        }
        for name, value in computed.items():
            object.__setattr__(self, name, value)  # the record is frozen

    def _radius_of_others(self) -> float:
        return float(self._reals("wall_radius"))

    tension = staticmethod(tension)
    shear_stiffness = staticmethod(shear_stiffness)
    shear_damping = staticmethod(shear_damping)
