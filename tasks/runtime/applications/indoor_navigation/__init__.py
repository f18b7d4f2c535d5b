"""Simulation application `indoor-navigation`: a robot has to visit the rooms of a furnished world."""

from .environment import make_environment as make_environment

__all__ = ["make_environment"]
