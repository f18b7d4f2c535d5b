"""Pictures of a simulation: cameras, views, light, OpenGL and ray casting.

May import: `schemas`, `tasks.runtime.episode`.
"""

__all__ = ["backends", "cameras", "drawing", "gl", "ray_camera", "view_culling", "views"]
