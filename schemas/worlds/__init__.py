"""Worlds as data: `world.json`, what was proven of a world, its description, and polygons on the ground.

May import: `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["checks", "description", "polygons", "world"]
