"""Object stores with S3's interface: a directory, or an S3 endpoint, with the same layout."""

from .archives import ArchiveLimits, pack_tar_gz, unpack
from .configured_store import open_store
from .object_store import ObjectInfo, ObjectStore
from .publication import (
    MANIFEST_NAME,
    NEXT_NAME,
    fetch,
    finish_thinning,
    publish,
    read_manifest,
    removed_before,
    split_stored,
    store_unfinished,
    thin,
    unpublish,
)

__all__ = [
    "MANIFEST_NAME",
    "NEXT_NAME",
    "ArchiveLimits",
    "ObjectInfo",
    "ObjectStore",
    "fetch",
    "finish_thinning",
    "open_store",
    "pack_tar_gz",
    "publish",
    "read_manifest",
    "removed_before",
    "split_stored",
    "store_unfinished",
    "thin",
    "unpack",
    "unpublish",
]
