"""Robot applications: the programs that drive robots."""

from .application_handlers import register_operations

register_operations("robot")
