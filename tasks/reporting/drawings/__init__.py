"""Plans of worlds for the report, as SVG: walls, furniture, names of rooms, and the way that a robot drove.

May import: `schemas`.
"""

__all__ = ["frame", "plan", "svg", "trajectory"]
