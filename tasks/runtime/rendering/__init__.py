"""Pictures of a simulation: cameras, views, OpenGL and ray casting.

May import: `tasks.runtime.episode`.
"""

__all__ = ["backends", "cameras", "drawing", "gl", "ray_camera", "view_culling", "views"]
