# pyright: reportPrivateImportUsage=false
"""A repository as agents trust it, in a folder; and clients of TUF that check it as agents do."""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from tuf.api.exceptions import DownloadHTTPError
from tuf.api.metadata import TargetFile
from tuf.ngclient import FetcherInterface, Updater, UpdaterConfig

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.fleet.trust.keys import Machine
from prefect_robomaker.tasks.fleet.trust.metadata import Changes
from prefect_robomaker.tasks.fleet.trust.publishing import Publisher
from prefect_robomaker.tasks.fleet.trust.repository_files import RepositoryFiles
from prefect_robomaker.tasks.fleet.trust.roles import FOLDER, application_role, target_key
from prefect_robomaker.tasks.storage.directory import DirectoryStore
from prefect_robomaker.tasks.storage.object_store import ObjectInfo, ObjectStore

BUCKET = "robomaker"
ADDRESS = "http://repository/"


class Killed(BaseException):
    """The process is dead."""


class MortalStore:
    """An object store whose process is killed at one of its writes, before or after it took effect.

    Args:
        store: The store.
        kill_at: Number of the write, from 1; 0: none.
        after: Whether that write takes effect.
        on_write: Called after each write.
    """

    def __init__(
        self,
        store: ObjectStore,
        kill_at: int = 0,
        *,
        after: bool = False,
        on_write: Callable[[], object] = lambda: None,
    ) -> None:
        self._store = store
        self._kill_at = kill_at
        self._after = after
        self._on_write = on_write
        self.writes = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        return self._write(lambda: self._store.put_bytes(bucket, key, data, create_only=create_only))

    def put_file(self, bucket: str, key: str, path: Path, **options: Any) -> ObjectInfo:
        return self._write(lambda: self._store.put_file(bucket, key, path, **options))

    def _write(self, write: Callable[[], ObjectInfo]) -> ObjectInfo:
        self.writes += 1
        if self.writes == self._kill_at and not self._after:
            raise Killed
        info = write()
        if self.writes == self._kill_at:
            raise Killed
        self._on_write()
        return info


class StoreFetcher(FetcherInterface):
    """Reads the repository as the door serves it, without a server in between."""

    def __init__(self, files: RepositoryFiles) -> None:
        self._files = files

    def _fetch(self, url: str) -> Iterator[bytes]:
        path = url.removeprefix(ADDRESS)
        try:
            if path == "metadata/timestamp.json":
                newest = self._files.newest_timestamp()
                if newest is None:
                    raise DownloadHTTPError("nothing is published", 404)
                yield newest[1]
            else:
                yield self._files.store.get_bytes(BUCKET, f"{FOLDER}/{path}")
        except ObjectNotFoundError as error:
            raise DownloadHTTPError(str(error), 404) from error


class TrustingRobot:
    """A client that keeps what it has seen, as an agent does.

    Args:
        files: The repository.
        root: The root that it was given.
        folder: Where it keeps what it has seen.
    """

    def __init__(self, files: RepositoryFiles, root: bytes, folder: Path) -> None:
        self._fetcher = StoreFetcher(files)
        self._root: bytes | None = root
        self._folder = folder

    def refresh(self) -> Updater:
        """Checks everything anew; raises what TUF raises."""
        updater = Updater(
            str(self._folder),
            f"{ADDRESS}metadata/",
            target_base_url=f"{ADDRESS}targets/",
            fetcher=self._fetcher,
            config=UpdaterConfig(),
            bootstrap=self._root,
        )
        updater.refresh()
        self._root = None
        return updater

    def content(self, path: str) -> bytes | None:
        """The content of a target, checked; `None`: there is none of that path."""
        updater = self.refresh()
        target = updater.get_targetinfo(path)
        if target is None:
            return None
        with tempfile.TemporaryDirectory() as folder:
            return Path(updater.download_target(target, str(Path(folder, "target")))).read_bytes()


@dataclass
class Trust:
    """A repository and a machine that publishes to it."""

    folder: Path
    now: datetime = field(default_factory=lambda: datetime.now(UTC))
    made: int = 0

    def publisher(self, machine: str = "trust", store: Any = None) -> Publisher:
        """A publisher; publishers of one machine share keys and what was seen."""
        files = RepositoryFiles(store or DirectoryStore(self.folder / "store"), BUCKET)
        return Publisher(files, Machine(self.folder / machine), lambda: self.now, self._bytes)

    def _bytes(self, count: int) -> bytes:
        self.made += 1
        return self.made.to_bytes(count, "big")

    def publish(self, path: str, content: bytes, publisher: Publisher | None = None) -> None:
        """Publishes one target."""
        by = publisher or self.publisher()
        application = path.split("/")[1]
        target = TargetFile.from_data(path, content, ["sha256"])
        by.files.store.ensure_bucket(BUCKET)
        by.files.store.put_bytes(BUCKET, target_key(path, target.hashes["sha256"]), content)
        by.publish(lambda _: Changes(add={application: {path: target}}), [application_role(application)])

    def robot(self) -> TrustingRobot:
        """A robot that was given the newest root."""
        publisher = self.publisher()
        root = publisher.root()
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        return TrustingRobot(publisher.files, publisher.files.metadata("root", root.signed.version), folder)

    def later(self, **duration: float) -> None:
        """Lets time pass."""
        self.now += timedelta(**duration)
