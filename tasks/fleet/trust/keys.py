"""Private keys of the TUF repository, and other files of one machine: ed25519, each in a file only its user can read.

A file is named after its role and its key, so that an old and a new key of one role can both exist while one replaces
the other.
"""

# pyright: reportPrivateImportUsage=false

import fcntl
import json
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
from tuf.api.metadata import Metadata, Root
from tuf.api.serialization import DeserializationError

from ....schemas.wire.errors import ConfigurationError
from ..artifacts import written
from .metadata import to_metadata

RandomBytes = Callable[[int], bytes]
"""Function that returns that many unpredictable bytes."""

_SEED_BYTES = 32
_SHOWN = 16


def new_key(role: str, folder: Path, random_bytes: RandomBytes) -> CryptoSigner:
    """Creates a signing key for a TUF role, and writes it into a folder.

    Args:
        role: TUF role of the key.
        folder: Folder for the key's file; it has to exist.
        random_bytes: Source of randomness.

    Raises:
        ConfigurationError: The file cannot be written.
    """
    private = Ed25519PrivateKey.from_private_bytes(random_bytes(_SEED_BYTES))
    signer = CryptoSigner(private)
    pem = private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    write_private(folder / f"{role}-{signer.public_key.keyid[:_SHOWN]}.pem", pem)
    return signer


def read_key(path: Path) -> CryptoSigner:
    """Reads a signing key of a TUF role from a file.

    Raises:
        ConfigurationError: The file does not exist, may not be read, or does not hold such a key.
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
    """A folder with signing keys of the update repository.

    Args:
        path: The folder; it is made when the first key is.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        """Path of the folder with signing keys."""

    @contextmanager
    def held(self) -> Iterator[None]:
        """Locks the folder of keys inside the block, so that one process at a time creates keys or a root.

        Creates the folder if it is missing, and waits for the lock. Raises ConfigurationError if it cannot be used.
        """
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            lock = (self.path / "lock").open("w")
        except OSError as error:
            raise ConfigurationError(f"{self.path} cannot be used: {error.strerror}") from error
        with lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def of_role(self, role: str) -> list[CryptoSigner]:
        """Returns the keys in the folder that are for a TUF role, ordered by file name."""
        return [read_key(path) for path in sorted(self.path.glob(f"{role}-*.pem"))]

    def among(self, role: str, keyids: Collection[str]) -> list[CryptoSigner]:
        """Returns the keys of a TUF role whose ids are among the given ones.

        Raises:
            ConfigurationError: No key of the role is here, so that nothing can be signed for the role.
        """
        found = [key for key in self.of_role(role) if key.public_key.keyid in keyids]
        if not found:
            raise ConfigurationError(
                f"{self.path} has no key with which robots let the role {role} sign; "
                "copy the folder from the machine that made the keys (docs/fleet/fleet-trust.md)"
            )
        return found

    def remove_others(self, role: str, keyids: Collection[str]) -> None:
        """Deletes keys of a TUF role that are not among the given ids, as robots no longer accept them."""
        for path in self.path.glob(f"{role}-*.pem"):
            if read_key(path).public_key.keyid not in keyids:
                path.unlink(missing_ok=True)


def write_private(path: Path, content: bytes, *, replace: bool = False) -> None:
    """Writes a whole file that only its user can read.

    Args:
        path: The file.
        content: All of it.
        replace: Whether it takes the place of another one; no key ever does.

    Raises:
        ConfigurationError: The file cannot be written.
    """
    try:
        with written(path, content, 0o600) as part:
            if replace:
                part.replace(path)
            else:
                path.hardlink_to(part)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be written: {error.strerror}") from error


_ROOT, _SEEN = "root.json", "seen.json"
_TIMESTAMP = "timestamp"


class Machine:
    """Keys and last known repository state of this machine, in the folder `robots/trust` of a data home.

    Args:
        folder: Folder of the keys.
    """

    def __init__(self, folder: Path) -> None:
        self.keys = KeyFolder(folder)
        """TUF signing keys of this machine."""

    @property
    def folder(self) -> Path:
        """Folder with this machine's TUF keys and last known repository state."""
        return self.keys.path

    def root(self) -> Metadata[Root] | None:
        """Returns the newest TUF root that this machine has seen; `None` if it has seen none.

        Raises:
            ConfigurationError: The file is no root.
        """
        path = self.folder / _ROOT
        try:
            return to_metadata(path.read_bytes(), Root)
        except FileNotFoundError:
            return None
        except (OSError, DeserializationError) as error:
            raise ConfigurationError(f"{path} is no root of a repository: {error}") from error

    def note_root(self, content: bytes) -> None:
        """Stores a newer TUF root as seen by this machine, in the place of the last one."""
        write_private(self.folder / _ROOT, content, replace=True)

    def seen(self) -> int:
        """Returns the number of the newest timestamp that this machine has seen or made; 0 if none.

        Raises:
            ConfigurationError: The file cannot be read.
        """
        path = self.folder / _SEEN
        try:
            return int(json.loads(path.read_bytes())[_TIMESTAMP])
        except FileNotFoundError:
            return 0
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{path} cannot be read: {error}; remove it if the store is whole") from error

    def note_seen(self, number: int) -> None:
        """Stores the number of a timestamp as seen; smaller numbers than before change nothing."""
        if number > self.seen():
            with self.keys.held():
                if number > self.seen():
                    content = json.dumps({_TIMESTAMP: number}).encode()
                    write_private(self.folder / _SEEN, content, replace=True)

    def check_seen(self, number: int, seen: int) -> None:
        """Raises an error if the object store has only older timestamps than were seen, which means it was set back.

        Args:
            number: Number of the newest timestamp in the store.
            seen: Result of `seen` before the store was read.

        Raises:
            ConfigurationError: The object store has only older timestamps, so it was reset to an earlier state.
        """
        if number < seen:
            raise ConfigurationError(
                f"the newest timestamp in the object store has number {number}, and this machine has seen {seen}: the "
                f"store was set back; restore it, or remove {self.folder / _SEEN} if robots shall go on from there"
            )

    @property
    def draft_path(self) -> Path:
        """Path of a TUF root that waits for the signatures of other key holders."""
        return self.folder / "next-root.json"
