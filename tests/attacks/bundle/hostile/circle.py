"""A module that imports one that imports it."""

from .circle_back import make_environment  # noqa: F401

START = 1
