"""Materials of floors and walls, and their textures.

May import: `schemas`, `tasks.worldforge.floorplans`, `tasks.worldforge.geometry`.
"""

__all__ = ["materials", "sky", "surfaces", "textures"]
