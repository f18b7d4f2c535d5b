# pyright: reportUnsupportedDunderAll=false
"""Processes on the robot: the child, scripts, the application; their rights, their sandbox, and what they leave behind.

May import: `..` of this package, `..child`.
"""

__all__ = ["application", "launching", "leftovers", "notify", "sandbox", "work"]
