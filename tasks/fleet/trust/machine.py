# pyright: reportPrivateImportUsage=false
"""Repository state that one machine keeps: its keys, the newest root it has seen, and the newest timestamp.

It lies in the data home, out of reach of those who can change the object store. So a store that was set back, or has
another root, is found out before anything is signed on top of it.
"""

import json
from pathlib import Path

from tuf.api.metadata import Metadata, Root
from tuf.api.serialization import DeserializationError

from ....schemas.wire.errors import ConfigurationError
from .keys import KeyFolder, write_private
from .metadata import to_metadata

_ROOT, _SEEN = "root.json", "seen.json"
_TIMESTAMP = "timestamp"


class Machine:
    """Keys and repository state in the folder `robots/trust` of a data home.

    Args:
        folder: that folder.
    """

    def __init__(self, folder: Path) -> None:
        self.keys = KeyFolder(folder)
        """The keys."""

    @property
    def folder(self) -> Path:
        """The folder."""
        return self.keys.path

    def root(self) -> Metadata[Root] | None:
        """The newest root that it has seen; `None`: it has seen none.

        Raises:
            ConfigurationError: the file is no root.
        """
        path = self.folder / _ROOT
        try:
            return to_metadata(path.read_bytes(), Root)
        except FileNotFoundError:
            return None
        except (OSError, DeserializationError) as error:
            raise ConfigurationError(f"{path} is no root of a repository: {error}") from error

    def note_root(self, content: bytes) -> None:
        """Notes a newer root."""
        write_private(self.folder / _ROOT, content, replace=True)

    def seen(self) -> int:
        """The number of the newest timestamp that it has seen or made; 0: none.

        Raises:
            ConfigurationError: the file cannot be read.
        """
        path = self.folder / _SEEN
        try:
            return int(json.loads(path.read_bytes())[_TIMESTAMP])
        except FileNotFoundError:
            return 0
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{path} cannot be read: {error}; remove it if the store is whole") from error

    def note_seen(self, number: int) -> None:
        """Notes the number of a timestamp; smaller ones than before change nothing."""
        if number > self.seen():
            with self.keys.held():
                if number > self.seen():
                    content = json.dumps({_TIMESTAMP: number}).encode()
                    write_private(self.folder / _SEEN, content, replace=True)

    def check_seen(self, number: int, seen: int) -> None:
        """Refuses a store that has only older timestamps than were seen.

        Args:
            number: of the newest in the store.
            seen: what `seen` said before the store was asked.

        Raises:
            ConfigurationError: it was set back.
        """
        if number < seen:
            raise ConfigurationError(
                f"the newest timestamp in the object store has number {number}, and this machine has seen {seen}: the "
                f"store was set back; restore it, or remove {self.folder / _SEEN} if robots shall go on from there"
            )

    @property
    def draft_path(self) -> Path:
        """Path of a root that waits for the signatures of other key holders."""
        return self.folder / "next-root.json"
