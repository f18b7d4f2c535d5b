"""Shapes that are only drawn: ornaments, procedural shapes, furniture drawn with these, small things.

May import: `schemas`, `tasks.worldforge.furniture`, `tasks.worldforge.geometry`.
"""

__all__ = ["books", "forms", "ornaments", "shaped", "things"]
