"""The problems of the library, one per file."""

import sys as _sys

from eig3.keywords import with_suggestions as _with_suggestions

from .arenstorf import arenstorf as arenstorf
from .argon import argon as argon
from .bouncing_ball import bouncing_ball as bouncing_ball
from .braced_frame import braced_frame as braced_frame
from .butane import butane as butane
from .curtain import curtain as curtain
from .damped_bar import damped_bar as damped_bar
from .double_pendulum import double_pendulum as double_pendulum
from .double_wishbone import double_wishbone as double_wishbone
from .duffing import duffing as duffing
from .elastic_bar import elastic_bar as elastic_bar
from .figure_eight import figure_eight as figure_eight
from .flag import flag as flag
from .four_bar import four_bar as four_bar
from .friction_oscillator import friction_oscillator as friction_oscillator
from .hardening_chain import hardening_chain as hardening_chain
from .hardening_spring import hardening_spring as hardening_spring
from .henon_heiles import henon_heiles as henon_heiles
from .hertz_impact import hertz_impact as hertz_impact
from .hopper import hopper as hopper
from .isolated_building import isolated_building as isolated_building
from .jelly import jelly as jelly
from .kepler import kepler as kepler
from .outer_solar_system import outer_solar_system as outer_solar_system
from .pounding_buildings import pounding_buildings as pounding_buildings
from .quarter_car import quarter_car as quarter_car
from .ragdoll import ragdoll as ragdoll
from .rail_joint import rail_joint as rail_joint
from .rod_chain import rod_chain as rod_chain
from .rotor import rotor as rotor
from .sand_column import sand_column as sand_column
from .shear_building import shear_building as shear_building
from .single_dof import single_dof as single_dof
from .slider_crank import slider_crank as slider_crank
from .sodium_chloride import sodium_chloride as sodium_chloride
from .softening_spring import softening_spring as softening_spring
from .spinning_top import spinning_top as spinning_top
from .spring_pendulum import spring_pendulum as spring_pendulum
from .squeezer import squeezer as squeezer
from .ten_storey_frame import ten_storey_frame as ten_storey_frame
from .tumbling_box import tumbling_box as tumbling_box
from .two_frequency_oscillator import two_frequency_oscillator as two_frequency_oscillator
from .van_der_pol import van_der_pol as van_der_pol
from .yielding_frame import yielding_frame as yielding_frame

__all__ = sorted(name for name in globals() if not name.startswith("_"))

for _name in __all__:  # also in its module, where pickle looks for it
    _build = globals()[_name]
    vars(_sys.modules[_build.__module__])[_name] = globals()[_name] = _with_suggestions()(_build)
