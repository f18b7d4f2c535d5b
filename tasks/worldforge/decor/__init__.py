"""Decoration that makes rooms look lived in, for the eye only: open windows, ceilings, lamps, skirting, cloth.

Nothing here collides, so that a decorated world steps like a plain one.

May import: `schemas`, `tasks.worldforge.doors`, `tasks.worldforge.furniture`, `tasks.worldforge.geometry`,
`tasks.worldforge.interiors`, `tasks.worldforge.materials`, `tasks.worldforge.ornaments`.
"""

__all__ = ["decor", "faces", "lights", "openings"]
