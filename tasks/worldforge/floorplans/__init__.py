"""Floor plans: rooms in a rectangle or set back from it, walls, ways between rooms, and the account of the preferences.

May import: `schemas`, `tasks.worldforge.doors`.
"""

__all__ = ["brief", "connections", "floorplan", "floors", "partition", "targets", "walls"]
