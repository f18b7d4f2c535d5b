"""Wraps a bundle into a signed `.swu`."""

import hashlib
from collections.abc import Iterator
from typing import BinaryIO

from ....schemas.wire.errors import BundleError
from .cpio import MAX_BYTES, write_end, write_member
from .description import BUNDLE, Release, describe
from .signing import SigningKey

_PART_BYTES = 1024 * 1024


def wrap(bundle: BinaryIO, release: Release, key: SigningKey, target: BinaryIO) -> str:
    """Wraps a bundle; it is read twice, and never lies in memory as a whole.

    Args:
        bundle: an archive (`.tar.gz`), open for reading, which can be rewound.
        release: what it is, and where it is unpacked.
        key: signs it.
        target: where the `.swu` is written.

    Returns:
        The SHA-256 of the bundle, in hexadecimal digits.

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
    for number, (name, content) in enumerate([("sw-description", description), ("sw-description.sig", signature)], 1):
        write_member(target, number, name, [content], len(content))
    bundle.seek(0)
    try:
        write_member(target, 3, BUNDLE, _parts(bundle), size_bytes)
    except ValueError as error:
        raise BundleError(f"the bundle changed while it was wrapped: {error}") from None
    write_end(target)
    return digest.hexdigest()


def _parts(bundle: BinaryIO) -> Iterator[bytes]:
    while part := bundle.read(_PART_BYTES):
        yield part
