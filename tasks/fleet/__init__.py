"""Fleets and robots in the catalog.

May import: `schemas`, `tasks.catalog`, `tasks.service`.
"""

__all__ = ["records"]
