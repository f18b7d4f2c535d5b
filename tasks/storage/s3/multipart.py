"""Multipart uploads of large objects: several parts at once, each read once; the server combines their CRC32.

boto3's own transfers read a file twice where its CRC32 is requested, and send it in pieces of 16 KB; that is two thirds
of the processor time that an upload takes.
"""

import os
import threading
import zlib
from concurrent.futures import FIRST_EXCEPTION, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from botocore.exceptions import BotoCoreError, ClientError

from ....schemas.wire.errors import ChecksumMismatchError, TransferStoppedError
from ..checksums import crc32_of_parts, crc32_text
from ..object_store import WORKERS, Stopped, never
from .quick_puts import QuickPuts, Stored

if TYPE_CHECKING:
    from types_boto3_s3 import S3Client
    from types_boto3_s3.type_defs import CompletedPartTypeDef

PART_BYTES = 8 << 20
_MOST_PARTS = 10_000  # that S3 takes for one object
_LOOK_S = 0.05


@dataclass(frozen=True)
class _Upload:
    bucket: str
    key: str
    id: str
    over: threading.Event
    """Event that is set when the upload is no longer wanted, or a part could not be stored."""


class _Sent(NamedTuple):
    """Part of a multipart upload that the server has stored, with its CRC32 and size in bytes."""

    part: "CompletedPartTypeDef"
    """Entry of a stored part in the request that completes a multipart upload."""
    crc: int
    size: int


class PartedUploads:
    """Multipart uploads to S3, which share one set of threads.

    Args:
        client: Begins and ends uploads, and stores the parts that the quick way does not.
        quick: The quick way; `None`: there is none.
    """

    def __init__(self, client: "S3Client", quick: QuickPuts | None) -> None:
        self._client = client
        self._quick = quick
        self._threads = ThreadPoolExecutor(WORKERS, thread_name_prefix="s3-parts")

    def upload(self, bucket: str, key: str, path: Path, stopped: Stopped = never) -> tuple[int, str]:
        """Uploads a file in parts; nothing remains of a failed or stopped upload.

        Args:
            bucket: The bucket.
            key: The object's key.
            path: The file, which is not empty.
            stopped: Called several times a second; true stops the upload.

        Returns:
            Size and CRC32, in base64, of what was sent. Where the server has lost sight of the upload at its end, the
            object may be stored or not.

        Raises:
            TransferStoppedError: `stopped` said so, and the object is as it was before.
            ChecksumMismatchError: The file was written to meanwhile.
        """
        with path.open("rb") as file:
            before = os.fstat(file.fileno())
            begun = self._client.create_multipart_upload(
                Bucket=bucket, Key=key, ChecksumAlgorithm="CRC32", ChecksumType="FULL_OBJECT"
            )
            upload = _Upload(bucket, key, begun["UploadId"], threading.Event())
            try:
                sent = self._send_all(upload, file.fileno(), before.st_size, stopped)
                after = os.fstat(file.fileno())
                if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
                    raise ChecksumMismatchError(f"{path} was written to while it was stored as {bucket}/{key}")
                whole = crc32_of_parts((each.crc, each.size) for each in sent)
                self._complete(upload, [each.part for each in sent], whole)
            except BaseException:  # Ctrl-C, too
                with suppress(ClientError, BotoCoreError):
                    self._client.abort_multipart_upload(Bucket=bucket, Key=key, UploadId=upload.id)
                raise
        return before.st_size, whole

    def _send_all(self, upload: _Upload, descriptor: int, size: int, stopped: Stopped) -> list[_Sent]:
        bytes_each = max(PART_BYTES, -(-size // _MOST_PARTS))
        starts = range(0, size, bytes_each)
        futures = [
            self._threads.submit(self._send, upload, number, descriptor, start, min(bytes_each, size - start))
            for number, start in enumerate(starts, 1)
        ]
        try:
            _await(futures, stopped, f"{upload.bucket}/{upload.key}")
        finally:
            upload.over.set()
            for future in futures:
                future.cancel()
            wait(futures)  # the file is closed, and the upload aborted, after the last one has ended
        return [future.result() for future in futures]

    def _send(self, upload: _Upload, number: int, descriptor: int, start: int, size: int) -> _Sent:
        if upload.over.is_set():
            raise CancelledError
        data = os.pread(descriptor, size, start)
        if len(data) != size:
            raise ChecksumMismatchError(f"the file was cut off while it was stored as {upload.bucket}/{upload.key}")
        crc = zlib.crc32(data)
        stored = self._store(upload, number, data, crc32_text(crc))
        part: CompletedPartTypeDef = {"PartNumber": number, "ETag": stored.etag}
        if stored.crc32:
            part["ChecksumCRC32"] = stored.crc32
        return _Sent(part, crc, size)

    def _store(self, upload: _Upload, number: int, data: bytes, crc32: str) -> Stored:
        query = f"partNumber={number}&uploadId={quote(upload.id, safe='~')}"
        if self._quick and (
            stored := self._quick.put(upload.bucket, upload.key, data, crc32, query=query, stopped=upload.over.is_set)
        ):
            return stored
        answer = self._client.upload_part(
            Bucket=upload.bucket,
            Key=upload.key,
            UploadId=upload.id,
            PartNumber=number,
            Body=_Body(data, upload.over),
            ChecksumCRC32=crc32,
        )
        return Stored(answer["ETag"].strip('"'), answer.get("ChecksumCRC32"))

    def _complete(self, upload: _Upload, parts: "list[CompletedPartTypeDef]", crc: str) -> None:
        try:
            self._client.complete_multipart_upload(
                Bucket=upload.bucket,
                Key=upload.key,
                UploadId=upload.id,
                MultipartUpload={"Parts": parts},
                ChecksumCRC32=crc,
                ChecksumType="FULL_OBJECT",
            )
        except ClientError as error:
            # When the answer to this request is lost, repeating it finds the upload gone because it is complete.
            if error.response.get("Error", {}).get("Code") != "NoSuchUpload":
                raise


class _Body(BytesIO):
    """File part as a request body, which stops being read when the upload is no longer wanted."""

    def __init__(self, data: bytes, over: threading.Event) -> None:
        super().__init__(data)
        self._over = over

    def read(self, size: int | None = -1, /) -> bytes:
        if self._over.is_set():
            raise CancelledError
        return super().read(size)


def _await(futures: list[Future[_Sent]], stopped: Stopped, what: str) -> None:
    """Waits for all parts, or for the first that fails.

    Raises:
        TransferStoppedError: `stopped` said so.
        Exception: The error with which a part failed.
    """
    left = set(futures)
    while left:
        done, left = wait(left, None if stopped is never else _LOOK_S, FIRST_EXCEPTION)
        for future in done:
            future.result()
        if left and stopped():
            raise TransferStoppedError(f"{what} is not wanted any more")
