"""Objects on S3 servers: one store, with quick ways for small objects and for the parts of large ones."""

from .store import S3Store

__all__ = ["S3Store"]
