"""Geometry that all of WorldForge uses: boxes, poses, primitive parts, the occupancy grid.

May import: `schemas`.
"""

__all__ = ["boxes", "occupancy", "parts"]
