"""The built-in simulation application `indoor-navigation`: a furnished world with a robot in it."""

from .environment import make_environment as make_environment

__all__ = ["make_environment"]
