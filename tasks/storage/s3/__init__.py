"""Object store on S3 servers, with faster paths for small objects and for parts of large ones."""

from .store import S3Store

__all__ = ["S3Store"]
