"""Simulation applications: what robots are tried in."""

from .applications.handlers import register_operations

register_operations("simulation")
