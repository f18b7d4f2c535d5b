"""Handlers of operations on robot applications, the programs that control robots."""

from .applications import register_operations

register_operations("robot")
