# pyright: reportUnsupportedDunderAll=false
"""Objects on S3 servers: one store, with quick ways for small objects and for the parts of large ones.

May import: `schemas`, `tasks.storage`.
"""

from .store import S3Store

__all__ = ["S3Store", "failures"]
