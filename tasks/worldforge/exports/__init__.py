"""Exports: ROS packages, SDF, GLB.

May import: `schemas`, `tasks.worldforge.bundle`.
"""

__all__ = ["export", "export_key", "glb"]
