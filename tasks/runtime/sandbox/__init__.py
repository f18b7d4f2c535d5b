"""The box that a run's processes are in: namespaces of their own, or else rules of the kernel for files.

May import: `schemas`, `tasks.runtime.limits`.
"""

__all__ = [
    "box",
    "connections",
    "forking",
    "landlock",
    "levels",
    "rights",
    "run_marks",
    "system_calls",
    "views",
]
