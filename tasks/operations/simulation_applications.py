"""Simulation applications: what robots are tried in."""

from .applications import register_operations

register_operations("simulation")
