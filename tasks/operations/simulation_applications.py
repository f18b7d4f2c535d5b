"""Simulation applications: what robots are tried in."""

from .application_handlers import register_operations

register_operations("simulation")
