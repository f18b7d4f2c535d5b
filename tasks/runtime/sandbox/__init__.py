"""The box that a run's processes are in: namespaces of their own, or else rules of the kernel for files.

May import: `schemas`, `tasks.runtime.limits`.
"""

__all__ = ["box", "forking", "landlock", "levels", "rights", "system_calls", "views"]
