"""The problems of the library, one per file."""

from .arenstorf import arenstorf
from .argon import argon
from .bouncing_ball import bouncing_ball
from .butane import butane
from .curtain import curtain
from .damped_bar import damped_bar
from .double_pendulum import double_pendulum
from .double_wishbone import double_wishbone
from .duffing import duffing
from .elastic_bar import elastic_bar
from .figure_eight import figure_eight
from .flag import flag
from .four_bar import four_bar
from .friction_oscillator import friction_oscillator
from .hardening_chain import hardening_chain
from .hardening_spring import hardening_spring
from .henon_heiles import henon_heiles
from .hertz_impact import hertz_impact
from .hopper import hopper
from .jelly import jelly
from .kepler import kepler
from .outer_solar_system import outer_solar_system
from .pounding_buildings import pounding_buildings
from .quarter_car import quarter_car
from .ragdoll import ragdoll
from .rail_joint import rail_joint
from .rod_chain import rod_chain
from .rotor import rotor
from .sand_column import sand_column
from .shear_building import shear_building
from .single_dof import single_dof
from .slider_crank import slider_crank
from .softening_spring import softening_spring
from .spinning_top import spinning_top
from .spring_pendulum import spring_pendulum
from .squeezer import squeezer
from .ten_storey_frame import ten_storey_frame
from .tumbling_box import tumbling_box
from .two_frequency_oscillator import two_frequency_oscillator
from .van_der_pol import van_der_pol

__all__ = [
    "arenstorf",
    "argon",
    "bouncing_ball",
    "butane",
    "curtain",
    "damped_bar",
    "double_pendulum",
    "double_wishbone",
    "duffing",
    "elastic_bar",
    "figure_eight",
    "flag",
    "four_bar",
    "friction_oscillator",
    "hardening_chain",
    "hardening_spring",
    "henon_heiles",
    "hertz_impact",
    "hopper",
    "jelly",
    "kepler",
    "outer_solar_system",
    "pounding_buildings",
    "quarter_car",
    "ragdoll",
    "rail_joint",
    "rod_chain",
    "rotor",
    "sand_column",
    "shear_building",
    "single_dof",
    "slider_crank",
    "softening_spring",
    "spinning_top",
    "spring_pendulum",
    "squeezer",
    "ten_storey_frame",
    "tumbling_box",
    "two_frequency_oscillator",
    "van_der_pol",
]
