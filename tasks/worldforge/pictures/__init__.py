"""Pictures of a world: the drawn plan, the preview from above, views from inside rooms.

May import: `schemas`, `tasks.worldforge.decor`, `tasks.worldforge.doors`, `tasks.worldforge.furniture`,
`tasks.worldforge.geometry`, `tasks.worldforge.interiors`, `tasks.worldforge.materials`, `tasks.worldforge.model`.
"""

__all__ = ["plan_svg", "preview", "ray_picture", "room_picture"]
