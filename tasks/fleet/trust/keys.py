# pyright: reportPrivateImportUsage=false
"""Private keys of the repository: ed25519, each in a file of its own that only its user reads.

A file is named after its role and its key, so that an old and a new key of one role can lie beside each other while
one takes the other's place.
"""

import fcntl
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from securesystemslib.signer import CryptoSigner

from ....schemas.wire.errors import ConfigurationError
from ..signing_keys import written

RandomBytes = Callable[[int], bytes]
"""Gives that many bytes that others cannot guess."""

_SEED_BYTES = 32
_SHOWN = 16


def new_key(role: str, folder: Path, random_bytes: RandomBytes) -> CryptoSigner:
    """Makes a key, and writes it into a folder.

    Args:
        role: what it is for.
        folder: where its file goes; it has to exist.
        random_bytes: where it comes from.

    Raises:
        ConfigurationError: the file cannot be written.
    """
    private = Ed25519PrivateKey.from_private_bytes(random_bytes(_SEED_BYTES))
    signer = CryptoSigner(private)
    pem = private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    write_private(folder / f"{role}-{signer.public_key.keyid[:_SHOWN]}.pem", pem)
    return signer


def read_key(path: Path) -> CryptoSigner:
    """Reads a key.

    Raises:
        ConfigurationError: it is not there, may not be read, or is no such key.
    """
    try:
        private = load_pem_private_key(path.read_bytes(), None)
    except OSError as error:
        raise ConfigurationError(f"the key {path} cannot be read: {error.strerror}") from error
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f"{path} is no private key in PEM without a password: {error}") from None
    if not isinstance(private, Ed25519PrivateKey):
        raise ConfigurationError(f"{path} is a {type(private).__name__}; agents check ed25519")
    return CryptoSigner(private)


class KeyFolder:
    """The keys that lie in a folder.

    Args:
        path: the folder; it is made when the first key is.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        """The folder."""

    @contextmanager
    def held(self) -> Iterator[None]:
        """Lets one process of this machine at a time make keys or a root; creates the folder."""
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            lock = (self.path / "lock").open("w")
        except OSError as error:
            raise ConfigurationError(f"{self.path} cannot be used: {error.strerror}") from error
        with lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def of_role(self, role: str) -> list[CryptoSigner]:
        """The keys that lie there for a role, by the names of their files."""
        return [read_key(path) for path in sorted(self.path.glob(f"{role}-*.pem"))]

    def among(self, role: str, keyids: Collection[str]) -> list[CryptoSigner]:
        """The keys of a role that are among some.

        Raises:
            ConfigurationError: there are none, so that nothing can be signed for it here.
        """
        found = [key for key in self.of_role(role) if key.public_key.keyid in keyids]
        if not found:
            raise ConfigurationError(
                f"{self.path} has no key with which robots let the role {role} sign; "
                "copy the folder from the machine that made the keys (docs/fleet-trust.md)"
            )
        return found

    def remove_others(self, role: str, keyids: Collection[str]) -> None:
        """Removes the keys of a role that no robot takes any more."""
        for path in self.path.glob(f"{role}-*.pem"):
            if read_key(path).public_key.keyid not in keyids:
                path.unlink(missing_ok=True)


def write_private(path: Path, content: bytes, *, replace: bool = False) -> None:
    """Writes a whole file that only its user reads.

    Args:
        path: the file.
        content: all of it.
        replace: whether it takes the place of another one; no key ever does.

    Raises:
        ConfigurationError: it cannot be written.
    """
    try:
        with written(path, content, 0o600) as part:
            if replace:
                part.replace(path)
            else:
                path.hardlink_to(part)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be written: {error.strerror}") from error
