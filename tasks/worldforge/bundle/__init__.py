"""World bundles: writing, reading, and the processes that build and draw them.

May import: `schemas`, `tasks.worldforge`, `tasks.worldforge.doors`, `tasks.worldforge.geometry`,
`tasks.worldforge.materials`, `tasks.worldforge.model`, `tasks.worldforge.pictures`.
"""

__all__ = ["bundle", "plain_names", "robot_map"]
