"""World bundles: writing, reading, and the process that builds them.

May import: `schemas`, `tasks.worldforge`, `tasks.worldforge.doors`, `tasks.worldforge.geometry`,
`tasks.worldforge.materials`, `tasks.worldforge.model`, `tasks.worldforge.pictures`.
"""

__all__ = ["bundle"]
