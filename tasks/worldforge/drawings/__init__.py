"""Floor plans that people drew: reading them, and the worlds they become.

May import: `schemas`, `tasks.worldforge`, `tasks.worldforge.doors`, `tasks.worldforge.floorplans`,
`tasks.worldforge.geometry`.
"""

__all__ = ["importing", "notes"]
