"""Floor plans: rooms cut from a rectangle, walls, ways between rooms, and the account of the preferences.

May import: `schemas`, `tasks.worldforge.doors`.
"""

__all__ = ["floorplan", "targets"]
