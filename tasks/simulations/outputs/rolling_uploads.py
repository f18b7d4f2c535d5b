"""Uploads during a run: every few seconds, finished files are moved aside and uploaded; the rest at the end.

The setting `upload_every_s` in `tasks/service/service.py` is the interval.

Moved files wait in a folder of the run, `rolling/<number of the sweep>/<configuration>/<path>`, so that a job worker
that continues after a crash knows what each of them is. `rolled.jsonl` lists the uploaded files, for the manifest.
"""

import json
import logging
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from ....schemas.runs.provenance import ManifestFile
from ....schemas.wire.errors import StorageError, TransferStoppedError
from ...files.untrusted_folders import regular_files
from ...storage import ObjectStore
from ...storage.checksums import digest_of
from ...storage.object_store import check_key, join_key
from .storable_files import Room
from .upload_files import Upload, take, visit_matches

_WAITING, _LEDGER = "rolling", "rolled.jsonl"
_JOIN_S = 30.0

_logger = logging.getLogger(__name__)


class RollingUploads:
    """Uploads finished output files of a running simulation every few seconds. Context manager.

    Args:
        uploads: Upload configurations; see `rolling_only`.
        folder: Folder of the run.
        store: Object store that files are uploaded to.
        bucket: Name of the bucket.
        prefix: Prefix of the run's outputs.
        every_s: Seconds between two polls for finished files.
        room: Space left for files of the run; files without space wait for the end, where they are recorded as left
            out.
    """

    def __init__(
        self,
        uploads: Sequence[Upload],
        folder: Path,
        store: ObjectStore,
        bucket: str,
        prefix: str,
        every_s: float,
        room: Room | None = None,
    ) -> None:
        self._uploads = rolling_only(uploads)
        self._folder = folder
        self._store = store
        self._bucket = bucket
        self._prefix = prefix
        self._every_s = every_s
        self._room = room
        self._sizes = {file.path: file.size_bytes for file in rolled_files(folder, later=[])}
        self._sizes |= {name: path.lstat().st_size for name, path in taken_files(folder)}
        self._used_bytes = sum(self._sizes.values())
        self._sweeps = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._go_on, name=f"uploads to {prefix}", daemon=True)

    def __enter__(self) -> "RollingUploads":
        if self._uploads:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._uploads:
            self._thread.join(_JOIN_S)

    def sweep(self) -> None:
        """Moves files that the running job has finished aside, uploads them, and deletes them here.

        A failed upload raises `StorageError`; its file is retried at the next call. Returns early if the run has ended.
        """
        for upload in self._uploads:
            if os.path.lexists(self._folder / "output" / upload.name):
                continue  # they get names of their own at the end, which the run's own outputs do not have
            target = self._folder / _WAITING / f"{self._sweeps:08d}" / upload.name
            visit_matches(upload.sandbox.root, upload.glob, self._taker(target))
        self._sweeps += 1
        for name, path in taken_files(self._folder):
            if self._ended.is_set():
                return  # what is left is stored with the other outputs
            self._store_one(name, path)

    def _go_on(self) -> None:
        while not self._ended.wait(self._every_s):
            try:
                self.sweep()
            except TransferStoppedError:
                return  # the run has ended, and the rest is stored with the other outputs
            except (StorageError, OSError) as error:
                _logger.warning("rolling uploads to %s/%s wait: %s", self._bucket, self._prefix, error)

    def _taker(self, target: Path) -> Callable[[int, str, str], None]:
        def visit(folder: int, name: str, below: str) -> None:
            with suppress(OSError, StorageError):  # it may be gone; what cannot be taken is noted at the end
                key, size = f"{target.name}/{below}", os.stat(name, dir_fd=folder, follow_symlinks=False).st_size
                check_key(join_key(self._prefix, key))
                more = size - self._sizes.get(key, 0)  # a later version takes the place of the one before
                if not self._ended.is_set() and self._has_room(key, more) and take(folder, name, target / below):
                    self._sizes[key] = size
                    self._used_bytes += more

        return visit

    def _has_room(self, key: str, more_bytes: int) -> bool:
        """Returns whether a file fits in the space that is left beside the files moved so far."""
        room = self._room
        if room is None:
            return True
        files = len(self._sizes) + (key not in self._sizes)
        return self._used_bytes + more_bytes <= room.most_bytes and files <= room.most_files

    def _store_one(self, name: str, path: Path) -> None:
        with path.open("rb") as content:
            digest, size = digest_of(content.fileno(), "sha256", self._ended.is_set)
        self._store.put_file(self._bucket, join_key(self._prefix, name), path, stopped=self._ended.is_set)
        if self._ended.is_set():
            return  # a store that hung answers only now, and the file may be stored with the other outputs already
        with (self._folder / _LEDGER).open("a") as ledger:
            ledger.write(json.dumps({"path": name, "size_bytes": size, "sha256": digest}) + "\n")
        path.unlink()


def rolling_only(uploads: Iterable[Upload]) -> list[Upload]:
    """Returns the upload configurations whose files are uploaded during the run.

    Of several with one name it is the first, since files of the others get other names at the end.
    """
    first: dict[str, Upload] = {}
    for upload in uploads:
        if upload.is_rolling:
            first.setdefault(upload.name, upload)
    return list(first.values())


def taken_files(folder: Path) -> list[tuple[str, Path]]:
    """Lists the files moved aside for upload that are not uploaded yet, oldest first.

    Args:
        folder: Folder of the run.

    Returns:
        Name among the run's outputs, and path, of each file.
    """
    waiting = folder / _WAITING
    if not waiting.is_dir():
        return []
    return [
        (file.name, file.path) for sweep in sorted(waiting.iterdir()) if sweep.is_dir() for file in regular_files(sweep)
    ]


def rolled_files(folder: Path, later: Iterable[str]) -> list[ManifestFile]:
    """Lists the files uploaded during the run, as they are stored now.

    Args:
        folder: Folder of the run.
        later: Names of files that are uploaded again and replace the earlier ones.
    """
    ledger = folder / _LEDGER
    if not ledger.is_file():
        return []
    last: dict[str, ManifestFile] = {}
    for line in ledger.read_text().splitlines():
        with suppress(ValueError):  # half a line, of a job worker that died
            entry = ManifestFile.model_validate_json(line)
            last[entry.path] = entry
    return [entry for path, entry in sorted(last.items()) if path not in set(later)]
