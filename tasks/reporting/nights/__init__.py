"""The page of a specification's history, and words about what changed since when.

May import: `schemas`, `tasks.reporting`.
"""

__all__ = ["changes", "view"]
