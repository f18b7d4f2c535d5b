"""Fleets and robots in the catalog, what robots and server say to each other, and bundles that updaters install.

May import: `schemas`, `tasks.catalog`, `tasks.service`.
"""

__all__ = ["records"]
