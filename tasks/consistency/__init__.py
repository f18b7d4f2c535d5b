# pyright: reportUnsupportedDunderAll=false
"""Whether what the catalog says is stored is in the object store, whole; and mending what can be mended.

May import: `schemas`, `tasks.catalog`, `tasks.jobs`, `tasks.service`, `tasks.storage`, `tasks.worlds`.
"""

__all__ = ["checking"]
