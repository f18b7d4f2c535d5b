"""The world as MJCF, and its description for other programs.

May import: `schemas`, `tasks.worldforge.decor`, `tasks.worldforge.doors`, `tasks.worldforge.furniture`,
`tasks.worldforge.geometry`, `tasks.worldforge.interiors`, `tasks.worldforge.materials`, `tasks.worldforge.ornaments`,
`tasks.worldforge.proofs`.
"""

__all__ = ["description", "mjcf"]
