"""The furniture catalogue: kinds, styles, and the parts that each is built from.

May import: `schemas`, `tasks.worldforge.geometry`.
"""

__all__ = ["arrangement", "catalogue", "solids", "tops"]
