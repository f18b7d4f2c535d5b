"""Interiors: which furniture stands where, and small objects that lie about.

May import: `schemas`, `tasks.worldforge.doors`, `tasks.worldforge.floorplans`, `tasks.worldforge.furniture`,
`tasks.worldforge.geometry`, `tasks.worldforge.materials`.
"""

__all__ = ["interior", "placement"]
