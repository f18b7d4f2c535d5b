"""What a run leaves: its outputs and the files that upload configurations mean, stored in one place."""

import os
import time
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.documents.worlds import StoredPlace
from ....schemas.wire.errors import (
    BucketNotFoundError,
    ChecksumMismatchError,
    CredentialsRefusedError,
    LaunchError,
    StorageAccessDeniedError,
    StorageError,
)
from ...catalog import Resource
from ...runtime.supervision.finished_outputs import add_result_notes
from ...service.service import Service
from ...storage import MANIFEST_NAME, publish, read_manifest, store_unfinished
from ...storage.base import Stopped, never
from ...storage.folders import FolderFile, regular_files
from ...storage.naming import check_key, join_key
from ..environment.role_access import acting_service, role_of
from .distinct_names import Found, distinct
from .output_places import output_place, prepare_bucket
from .result_notes import keep_new_bucket, notes_of
from .rolling_uploads import RollingUploads, rolled_files, rolling_only, taken_files
from .storable_files import storable_files
from .upload_configurations import Upload, uploads_of
from .upload_files import link_or_copy, visit_matches

NOT_STORED = ("output", "uploads", "rolling", "rolled.jsonl")
"""What of a run's folder stays when it could not be stored."""

Visit = Callable[[int, str, str], None]
"""Takes a file that matches: its folder's descriptor, its name, and its path below the fixed part of the pattern."""

_MOST_CHANGES = 3
_NOTES = "logs/uploads.log"
_MOST_NOTES = 200


class RunOutputs:
    """Outputs of one run of a job.

    Args:
        job: the job.
        run_id: the run.
        folder: the run's own folder.
        service: where they are stored.
        sleep: waits, in seconds.
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
        self.bucket, self.prefix = output_place(job, run_id, service)

    @property
    def output_dir(self) -> Path:
        """Where the run writes."""
        return self._folder / "output"

    @property
    def place(self) -> StoredPlace:
        """Where they are stored."""
        return StoredPlace(bucket=self.bucket, prefix=self.prefix)

    @property
    def _request(self) -> Mapping[str, Any]:
        return SimulationJobDocument.of(self._job).request

    def prepare(self) -> None:
        """Finds out before a long run that its outputs have nowhere to go.

        Raises:
            LaunchError: there is no such bucket, or the job's role may not write there, or is none.
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
        """The uploads while the run goes on."""
        every_s = self._service.timing.upload_every_s
        store = acting_service(self._request, self._service).store
        return RollingUploads(self._uploads(), self._folder, store, self.bucket, self.prefix, every_s)

    def store(
        self,
        about: Mapping[str, Any],
        *,
        finished: bool,
        stopped: Stopped = never,
        resumes: bool = False,
        outdated: Stopped = never,
    ) -> StoredPlace:
        """Stores them; returns where.

        What a crashed or killed run left is stored too, but without a manifest: it is not whole. A store that does
        not answer is waited for, see `Service.patient`; a file that changes is stored again, a few times.

        Args:
            about: how the run ended.
            finished: whether it is whole.
            stopped: asked while the store does not answer whether to give up. What is stored of a job that was told to
                stop before has a short grace instead.
            resumes: whether an earlier attempt may have stored a part of them.
            outdated: asked before the manifest is written, whether the run ended in another way than `about` says.

        Raises:
            TransferStoppedError: it is outdated.
            StorageError: that does not work.
            OSError: the outputs cannot be read.
        """
        service = self._patient(stopped)
        uploaded = self._stage()
        for changes_left in reversed(range(_MOST_CHANGES)):
            try:
                self._store_once(service, about, uploaded, finished=finished, resumes=resumes, outdated=outdated)
                break
            except ChecksumMismatchError:
                resumes = True
                if not changes_left:
                    raise
        return self.place

    def were_stored(self, stopped: Stopped = never) -> None:
        """Checks that they are stored as a whole; a store that does not answer is waited for.

        Args:
            stopped: see `store`.

        Raises:
            StorageError: they are not.
        """
        read_manifest(self._patient(stopped).store, self.bucket, self.prefix)

    def not_stored(self, error: Exception) -> str:
        """Says what went wrong, where the outputs are, and what stores them later."""
        return (
            f"outputs could not be stored in s3://{self.bucket}/{self.prefix}: {error}; "
            f"`robomaker upload --kept` stores them; they are in {self.output_dir}"
        )

    def _patient(self, stopped: Stopped) -> Service:
        """The service as the job's role has it, whose store waits: not for long if the job was told to stop before."""
        service = self._service.acting_as(role_of(self._request))
        if stopped is not never and stopped():
            return service.patient(self._job.id, never, patience_s=service.timing.store_grace_s, sleep=self._sleep)
        return service.patient(self._job.id, stopped, sleep=self._sleep)

    def _store_once(
        self,
        service: Service,
        about: Mapping[str, Any],
        uploaded: Sequence[FolderFile],
        *,
        finished: bool,
        resumes: bool,
        outdated: Stopped,
    ) -> None:
        store = service.store
        prepare_bucket(service, self.bucket)
        files = [*storable_files(self.output_dir, self.prefix).files, *uploaded]
        if not finished:
            store_unfinished(store, self.bucket, self.prefix, files, resumes=resumes)
            return
        publish(
            store,
            self.bucket,
            self.prefix,
            files,
            about={
                "job": self._job.arn,
                "run": self._run_id,
                "seed": SimulationJobDocument.of(self._job).seed,
                **about,
            },
            created_at=self._service.clock(),
            stored=rolled_files(self._folder, [file.name for file in files]),
            resumes=resumes,
            stopped=outdated,
        )

    def _uploads(self) -> list[Upload]:
        return uploads_of(self._request, self._folder)

    def _stage(self) -> list[FolderFile]:
        """The files that upload configurations mean, under the names that they are stored by; all code has stopped.

        They are linked into folders of their own, one for each configuration, so that a job worker that goes on after a
        crash finds them too, and finds the same.
        """
        staged, uploads = self._folder / "uploads", self._uploads()
        notes: list[str] = []
        rolling = rolling_only(uploads)
        files = [Found(name, path, replaces=True) for name, path in taken_files(self._folder)]
        matched = self._matched_before(uploads, {file.name for file in files})
        seen: set[tuple[str, int, int]] = set()
        for index, upload in enumerate(uploads):
            folder = staged / f"{index:02d}"
            stage = self._stager(upload, folder, seen, notes)
            visit_matches(upload.sandbox.root, upload.glob, _counted(stage, index, matched))
            if folder.is_dir():
                found = regular_files(folder)
                files += [Found(f"{upload.name}/{file.name}", file.path, upload in rolling) for file in found]
        add_result_notes(self.output_dir, notes_of(self._request, self._folder, uploads, matched))
        outputs = storable_files(self.output_dir, self.prefix)
        names = [file.name for file in outputs.files]
        return self._named(names, files, staged / "notes.log", [*outputs.notes, *notes])

    def _matched_before(self, uploads: Sequence[Upload], taken: Set[str]) -> set[int]:
        """Numbers of upload configurations of which files were taken while the run went on, or staged before."""
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

    def _stager(self, upload: Upload, folder: Path, seen: set[tuple[str, int, int]], notes: list[str]) -> Visit:
        def visit(descriptor: int, name: str, below: str) -> None:
            try:
                about = os.stat(name, dir_fd=descriptor, follow_symlinks=False)
                same = (f"{upload.name}/{below}", about.st_dev, about.st_ino)
                if same in seen:
                    return  # another configuration means the same file by the same name
                check_key(join_key(self.prefix, upload.name, below))
                link_or_copy(descriptor, name, folder / below)
                seen.add(same)
            except (StorageError, OSError) as error:
                notes.append(f"{upload.name}/{below!r} is not uploaded: {error}")

        return visit


def _counted(visit: Visit, index: int, matched: set[int]) -> Visit:
    """A visitor that notes besides that something matched."""

    def counted(descriptor: int, name: str, below: str) -> None:
        matched.add(index)
        visit(descriptor, name, below)

    return counted


def failure_code_of(error: Exception) -> str:
    """The job's failure code for outputs that could not be stored."""
    if isinstance(error, CredentialsRefusedError):
        return "BadPermissionsUserCredentials"
    if isinstance(error, StorageAccessDeniedError | BucketNotFoundError):
        return "BadPermissionsS3Output"
    return "UploadContentMismatchError" if isinstance(error, ChecksumMismatchError) else "InternalServiceError"
