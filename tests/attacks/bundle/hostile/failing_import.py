"""A module that cannot be imported."""

SPEED = 1 / 0
