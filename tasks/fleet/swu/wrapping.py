"""Wraps a bundle into a signed `.swu`."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from ....schemas.wire.errors import BundleError
from .cpio import MAX_BYTES, write_end, write_member
from .description import BUNDLE, Release, describe
from .signing import SigningKey

_PART_BYTES = 1024 * 1024


@dataclass(frozen=True)
class Wrapped:
    """Size and hashes of a `.swu`, for orders."""

    size_bytes: int
    sha256: str
    sha1: str
    md5: str
    bundle_sha256: str


def wrap(bundle: BinaryIO, release: Release, key: SigningKey, target: BinaryIO) -> Wrapped:
    """Wraps a bundle; it is read twice, and never lies in memory as a whole.

    Args:
        bundle: an archive (`.tar.gz`), open for reading, which can be rewound.
        release: what it is, and where it is unpacked.
        key: signs it.
        target: where the `.swu` is written.

    Returns:
        Length and hashes of what was written, and the hash of the bundle in it.

    Raises:
        BundleError: the bundle is empty, has 4 GiB or more, or changed meanwhile.
        InvalidParameterException: a text of the release is not right.
    """
    bundle.seek(0)
    digest, size_bytes = hashlib.sha256(), 0
    for part in _parts(bundle):
        digest.update(part)
        size_bytes += len(part)
    if not 0 < size_bytes <= MAX_BYTES:
        raise BundleError(f"the bundle has {size_bytes} bytes; a .swu takes 1 to {MAX_BYTES}")
    description = describe(release, digest.hexdigest())
    signature = key.sign(description)
    measured = _Measured(target)
    for number, (name, content) in enumerate([("sw-description", description), ("sw-description.sig", signature)], 1):
        write_member(measured, number, name, [content], len(content))
    bundle.seek(0)
    try:
        write_member(measured, 3, BUNDLE, _parts(bundle), size_bytes)
    except ValueError as error:
        raise BundleError(f"the bundle changed while it was wrapped: {error}") from None
    write_end(measured)
    return measured.result(digest.hexdigest())


def _parts(bundle: BinaryIO) -> Iterator[bytes]:
    while part := bundle.read(_PART_BYTES):
        yield part


class _Measured:
    """Writes to a file, and measures what is written."""

    def __init__(self, target: BinaryIO) -> None:
        self._target = target
        self._size_bytes = 0
        self._sha256 = hashlib.sha256()
        # Robots ask for these two; neither protects anything, the signature does.
        self._sha1 = hashlib.sha1(usedforsecurity=False)
        self._md5 = hashlib.md5(usedforsecurity=False)

    def write(self, data: bytes) -> int:
        for each in (self._sha256, self._sha1, self._md5):
            each.update(data)
        self._size_bytes += len(data)
        return self._target.write(data)

    def result(self, bundle_sha256: str) -> Wrapped:
        sha256, sha1, md5 = (each.hexdigest() for each in (self._sha256, self._sha1, self._md5))
        return Wrapped(self._size_bytes, sha256, sha1, md5, bundle_sha256)
