"""Upload of a run's outputs and of the files that its upload configurations select."""

import os
import time
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.documents.worlds import StoredPlace
from ....schemas.runs.provenance import ManifestFile
from ....schemas.wire.errors import (
    BucketNotFoundError,
    ChecksumMismatchError,
    CredentialsRefusedError,
    LaunchError,
    StorageAccessDeniedError,
    StorageError,
)
from ...catalog import Resource
from ...files.untrusted_folders import FolderFile, regular_files
from ...runtime.supervision.finished_outputs import add_result_notes
from ...service.service import Service
from ...storage import MANIFEST_NAME, publish, read_manifest, store_unfinished
from ...storage.object_store import Stopped, check_key, join_key, never
from ..environment.role_access import acting_service, role_of
from .output_places import keep_new_bucket, notes_of, output_place, prepare_bucket
from .rolling_uploads import RollingUploads, rolled_files, rolling_only, taken_files
from .storable_files import FIRST, RESULT_FILE, Found, LeftOut, Room, check_wanted, distinct, rank, storable_files
from .upload_files import Upload, Visit, link_or_copy, uploads_of, visit_matches

NOT_STORED = ("output", "uploads", "rolling", "rolled.jsonl")
"""Names in a run's folder that are kept if the upload fails."""

_MOST_CHANGES = 3
_NOTES = "logs/uploads.log"
_PARTIAL_NOTE = "logs/partial.log"
"""Name of a stored note about an incomplete run whose upload was cancelled; such a run has no manifest."""
_MOST_NOTES = 200


class RunOutputs:
    """Uploads the outputs of one run of a simulation job.

    Args:
        job: The job.
        run_id: Id of the run.
        folder: Folder of the run.
        service: The service, with its catalog and object store.
        sleep: Function that waits for some seconds.
    """

    def __init__(
        self,
        job: Resource,
        run_id: str,
        folder: Path,
        service: Service,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._job = job
        self._run_id = run_id
        self._folder = folder
        self._service = service
        self._sleep = sleep
        self._planned: list[FolderFile] | None = None
        """Files to upload; `None`: they have not been listed yet."""

        self._arrived: dict[str, ManifestFile | None] = {}
        self._left_out = LeftOut()
        self.bucket, self.prefix = output_place(job, run_id, service)

    @property
    def output_dir(self) -> Path:
        """Local folder of the run's outputs."""
        return self._folder / "output"

    @property
    def place(self) -> StoredPlace:
        """Bucket and prefix of the run's outputs in the object store."""
        return StoredPlace(bucket=self.bucket, prefix=self.prefix)

    @property
    def _request(self) -> Mapping[str, Any]:
        return SimulationJobDocument.of(self._job).request

    def prepare(self) -> None:
        """Checks, before a long run begins, that its outputs can be uploaded.

        Raises:
            LaunchError: The bucket does not exist, the job's role may not write to it, or the role does not exist.
        """
        service = acting_service(self._request, self._service)
        try:
            if service is self._service:  # a role may not be told of buckets, which may be others'
                keep_new_bucket(service, self.bucket, self._folder)
            prepare_bucket(service, self.bucket)
            if service is not self._service:  # own credentials that lack rights are found out at the end, as ever
                service.store.check_writable(self.bucket, join_key(self.prefix, MANIFEST_NAME))
        except (BucketNotFoundError, StorageAccessDeniedError) as error:
            raise LaunchError(f"outputLocation.s3Bucket: {error}", "BadPermissionsS3Output") from error

    def rolling(self) -> RollingUploads:
        """Returns the uploader, not yet started, of files that programs finish during the run."""
        every_s = self._service.timing.upload_every_s
        store = acting_service(self._request, self._service).store
        room = Room.of(self._service.settings)
        return RollingUploads(self._uploads(), self._folder, store, self.bucket, self.prefix, every_s, room)

    def store(
        self,
        about: Mapping[str, Any],
        *,
        finished: bool,
        stopped: Stopped = never,
        resumes: bool = False,
        outdated: Stopped = never,
        ended: Stopped = never,
    ) -> StoredPlace:
        """Uploads the run's outputs, and returns their place in the object store.

        Files without space are left out; the manifest names them. Outputs of a crashed or killed run are uploaded
        without a manifest, since they are incomplete. If the store does not answer, the upload waits, see
        `Service.patient`; a file that changes meanwhile is uploaded again, a few times.

        Args:
            about: Description of the run's end.
            finished: Whether the outputs are complete.
            stopped: Function called while the store does not answer; true gives up. If the job was told to stop before,
                there is a short time limit instead.
            resumes: Whether an earlier attempt may have uploaded a part of the files.
            outdated: Function called before the manifest is written; true means that the run ended in another way than
                `about` says.
            ended: Function called all the time, so it has to be fast; true stops the upload at once, and `conclude`
                must follow.

        Raises:
            TransferStoppedError: `outdated` or `ended` returned true.
            StorageError: The outputs cannot be stored.
            OSError: The outputs cannot be read.
        """
        service = self._patient(stopped)
        uploaded = self._stage(ended)

        def store_once(*, resumes: bool) -> None:
            prepare_bucket(service, self.bucket)
            files = [*storable_files(self.output_dir, self.prefix, self._room(), ended), *uploaded]
            files.sort(key=lambda file: rank(file.name))  # what says how the run went is stored first
            self._planned, self._arrived = files, {}
            place = service.store, self.bucket, self.prefix, files
            if not finished:
                start = len(join_key(self.prefix, "x")) - 1
                tell = lambda key: self._arrived.update({key[start:]: None})  # noqa: E731
                store_unfinished(*place, resumes=resumes, ended=ended, tell=tell)
                return
            publish(
                *place,
                about=self._about(about),
                created_at=self._service.clock(),
                stored=rolled_files(self._folder, [file.name for file in files]),
                resumes=resumes,
                stopped=outdated,
                ended=ended,
                tell=lambda file: self._arrived.update({file.path: file}),
            )

        for changes_left in reversed(range(_MOST_CHANGES)):
            try:
                store_once(resumes=resumes)
                break
            except ChecksumMismatchError:
                resumes = True
                if not changes_left:
                    raise
        return self.place

    def conclude(self, about: Mapping[str, Any], *, finished: bool) -> tuple[StoredPlace, str | None]:
        """Publishes the files, usually not all, that were uploaded before the upload was stopped.

        Args:
            about: Description of the run's end.
            finished: Whether the run was complete; otherwise no manifest is made.

        Returns:
            Place of the outputs, and a description of the uploaded part; `None`: all of them.

        Raises:
            StorageError: The manifest cannot be stored.
            OSError: The result cannot be read.
        """
        service = self._patient(lambda: True)
        prepare_bucket(service, self.bucket)
        planned = self._planned
        if planned is None:
            is_part, planned = True, self._first_files()
            words = "storing outputs was cancelled while they were listed: "
            words += "only how the run went is stored" if finished else "none of them is stored"
            self._left_out.note("...", "was not listed yet when storing was cancelled, like all other outputs")
        else:
            for file in planned:
                if file.name not in self._arrived:
                    self._left_out.note(file.name, "was not stored yet when that was cancelled", _size_of(file.path))
            stored = len(self._arrived)
            is_part = stored < len(planned)
            words = f"storing outputs was cancelled: {stored} of {len(planned)} files are stored" if is_part else None
        if not finished:
            if words:
                service.store.put_bytes(self.bucket, join_key(self.prefix, _PARTIAL_NOTE), f"{words}\n".encode())
            return self.place, words
        # The result may have changed: a run that was cancelled is judged no more.
        again = planned if self._planned is None else [file for file in planned if file.name == RESULT_FILE]
        publish(
            service.store,
            self.bucket,
            self.prefix,
            again,
            about=self._about({**about, **({"partial": True} if is_part else {})}),
            created_at=self._service.clock(),
            stored=[
                *(file for name, file in self._arrived.items() if file is not None and name != RESULT_FILE),
                *rolled_files(self._folder, [file.name for file in planned]),
            ],
        )
        return self.place, words

    def _first_files(self) -> list[FolderFile]:
        """Returns the files that say how the run went, as far as they exist, without listing all outputs."""
        found = [FolderFile(name, self.output_dir / name) for name in FIRST]
        return [file for file in found if file.path.is_file() and not _is_linked(file.path)]

    def were_stored(self, stopped: Stopped = never) -> None:
        """Checks that the run's outputs were uploaded completely.

        Args:
            stopped: Function called while the store does not answer; true gives up.

        Raises:
            StorageError: The outputs were not uploaded completely.
        """
        read_manifest(self._patient(stopped).store, self.bucket, self.prefix)

    def not_stored(self, error: Exception) -> str:
        """Makes the text about a failed upload: the error, where the outputs are, and how to upload them later."""
        return (
            f"outputs could not be stored in s3://{self.bucket}/{self.prefix}: {error}; "
            f"`robomaker upload --kept` stores them; they are in {self.output_dir}"
        )

    def _patient(self, stopped: Stopped) -> Service:
        """Returns the service as the job's role, with a store that waits; only briefly if the job was told to stop."""
        service = self._service.acting_as(role_of(self._request))
        if stopped is not never and stopped():
            return service.patient(self._job.id, never, patience_s=service.timing.store_grace_s, sleep=self._sleep)
        return service.patient(self._job.id, stopped, sleep=self._sleep)

    def _about(self, about: Mapping[str, Any]) -> dict[str, Any]:
        """Makes the manifest's description of the run, and of the output files that were not stored.

        Args:
            about: Further members of the description.
        """
        job = {"job": self._job.arn, "run": self._run_id, "seed": SimulationJobDocument.of(self._job).seed}
        return {**job, **about, **self._left_out.about()}

    def _room(self) -> Room:
        """Returns the space left beside the files that were uploaded or moved aside during the run."""
        room = Room.of(self._service.settings)
        room.use(rolled_files(self._folder, later=[]))
        taken = taken_files(self._folder)
        room.used_files += len(taken)
        room.used_bytes += sum(_size_of(path) for _, path in taken)
        return room

    def _uploads(self) -> list[Upload]:
        return uploads_of(self._request, self._folder)

    def _stage(self, ended: Stopped) -> list[FolderFile]:
        """Collects and returns the files that upload configurations select, with stored names, after all programs end.

        The files are linked into folders, one for each configuration, so that a job worker that continues after a crash
        finds the same files.
        """
        staged, uploads, room = self._folder / "uploads", self._uploads(), self._room()
        outputs = storable_files(
            self.output_dir, self.prefix, room, ended
        )  # they have room before what is from elsewhere
        rolling = rolling_only(uploads)
        files = [Found(name, path, replaces=True) for name, path in taken_files(self._folder)]
        matched = self._matched_before(uploads, {file.name for file in files})
        seen: set[tuple[str, int, int]] = set()
        for index, upload in enumerate(uploads):
            folder = staged / f"{index:02d}"
            stage = self._stager(upload, folder, seen, room, ended)
            visit_matches(upload.sandbox.root, upload.glob, _counted(stage, index, matched))
            if folder.is_dir():
                found = regular_files(folder)
                files += [Found(f"{upload.name}/{file.name}", file.path, upload in rolling) for file in found]
        self._left_out = room.left_out
        add_result_notes(self.output_dir, [*notes_of(self._request, self._folder, uploads, matched), *room.notes()])
        names = [file.name for file in outputs]
        return self._named(names, files, staged / "notes.log", room.left_out.lines)

    def _matched_before(self, uploads: Sequence[Upload], taken: Set[str]) -> set[int]:
        """Returns the indices of upload configurations with files that were uploaded or collected before."""
        names = taken | {file.path for file in rolled_files(self._folder, later=[])}
        return {
            index
            for index, upload in enumerate(uploads)
            if (self._folder / "uploads" / f"{index:02d}").is_dir()
            or (upload.is_rolling and any(name.startswith(f"{upload.name}/") for name in names))
        }

    def _named(self, outputs: list[str], files: list[Found], notes_file: Path, notes: list[str]) -> list[FolderFile]:
        stored = {file.path for file in rolled_files(self._folder, later=[])}
        notes += [f"{name} of an upload was replaced by the run's own output" for name in sorted(stored & set(outputs))]
        placed, renamed = distinct(outputs, stored, files)
        if not (notes := [*notes, *renamed]):
            return placed
        notes_file.parent.mkdir(parents=True, exist_ok=True)
        notes_file.write_text("\n".join(notes[:_MOST_NOTES]) + "\n")
        told, _ = distinct([*outputs, *(file.name for file in placed)], stored, [Found(_NOTES, notes_file)])
        return [*placed, *told]

    def _stager(
        self, upload: Upload, folder: Path, seen: set[tuple[str, int, int]], room: Room, ended: Stopped
    ) -> Visit:
        def visit(descriptor: int, name: str, below: str) -> None:
            check_wanted(ended)
            try:
                about = os.stat(name, dir_fd=descriptor, follow_symlinks=False)
                same = (f"{upload.name}/{below}", about.st_dev, about.st_ino)
                if same in seen:
                    return  # another configuration means the same file by the same name
                check_key(join_key(self.prefix, upload.name, below))
                if not room.take(f"{upload.name}/{below}", about.st_size):
                    return
                link_or_copy(descriptor, name, folder / below)
                seen.add(same)
            except (StorageError, OSError) as error:
                room.left_out.note(f"{upload.name}/{below}", f"cannot be uploaded: {error}")

        return visit


def _is_linked(path: Path) -> bool:
    """Returns whether a path, or its folder (such as `logs`), is a link."""
    return path.is_symlink() or path.parent.is_symlink()


def _size_of(path: Path) -> int:
    """Returns a file's size in bytes; 0 if it does not exist any more."""
    try:
        return path.lstat().st_size
    except OSError:
        return 0


def _counted(visit: Visit, index: int, matched: set[int]) -> Visit:
    """Returns a visitor of files that calls another one and also records the configuration that matched."""

    def counted(descriptor: int, name: str, below: str) -> None:
        matched.add(index)
        visit(descriptor, name, below)

    return counted


def failure_code_of(error: Exception) -> str:
    """Returns the simulation job's failure code for the error of a failed upload."""
    if isinstance(error, CredentialsRefusedError):
        return "BadPermissionsUserCredentials"
    if isinstance(error, StorageAccessDeniedError | BucketNotFoundError):
        return "BadPermissionsS3Output"
    return "UploadContentMismatchError" if isinstance(error, ChecksumMismatchError) else "InternalServiceError"
