"""Exports: ROS packages, SDF, GLB, USD.

May import: `schemas`, `tasks.worldforge`, `tasks.worldforge.bundle`, `tasks.worldforge.pictures`.
"""

__all__ = ["export", "export_key", "export_scene", "glb"]
