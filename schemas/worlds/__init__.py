"""Worlds as data: `world.json`, how worlds are lit, what was proven of them, their description, polygons.

May import: `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["appearance", "checks", "description", "polygons", "step_operations", "world"]
