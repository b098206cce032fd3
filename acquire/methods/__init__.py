"""The ways of taking a scene apart."""

from acquire.methods.components import Components, Method
from acquire.methods.iva import Iva, check_components
from acquire.methods.pairs import Pairs
from acquire.methods.ranges import HARMONICS, Ranges, obstacle_to_ranges

__all__ = [
    "HARMONICS",
    "Components",
    "Iva",
    "Method",
    "Pairs",
    "Ranges",
    "check_components",
    "obstacle_to_ranges",
]
