"""Robot applications: the programs that drive robots."""

from .applications.handlers import register_operations

register_operations("robot")
