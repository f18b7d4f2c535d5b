"""The other half of a circle."""

from .circle import START

make_environment = START
