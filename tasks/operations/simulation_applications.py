"""Handlers of operations on simulation applications, the environments in which robots are tested."""

from .applications import register_operations

register_operations("simulation")
