"""Doors: where they hang, how far they are open, what they look like.

May import: `schemas`, `tasks.worldforge.furniture`, `tasks.worldforge.geometry`.
"""

__all__ = ["doors", "initial_states", "leaves", "model"]
