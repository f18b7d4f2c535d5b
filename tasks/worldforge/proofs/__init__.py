"""Guarantees of every world: measurements, limits, and the words for both.

May import: `schemas`, `tasks.worldforge.doors`, `tasks.worldforge.geometry`.
"""

__all__ = ["checks", "guarantees"]
