"""Robot applications: the programs that drive robots."""

from .applications import register_operations

register_operations("robot")
