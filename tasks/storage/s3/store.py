"""Objects on an S3 endpoint: AWS, SeaweedFS, MinIO, versitygw or any other that speaks S3.

Uploads carry their CRC32, which the server checks before it keeps anything; large ones go in parts
and are looked at again afterwards, size and CRC32 of the whole. A store has one client, and one set
of threads for the parts of all its uploads.

`create_only` needs a server that honours `If-None-Match`, as AWS, SeaweedFS, MinIO and versitygw do.
An uploader that is killed leaves the parts of large files at the server, where no client sees or needs
them: `robomaker fsck --mend` aborts such uploads, and so does a lifecycle rule of the bucket.
"""

import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, Protocol, TypedDict, cast

import boto3
from boto3.s3.transfer import TransferConfig, create_transfer_manager
from botocore.config import Config
from botocore.exceptions import ClientError, IncompleteReadError, ReadTimeoutError, ResponseStreamingError
from s3transfer.exceptions import S3DownloadFailedError
from s3transfer.subscribers import BaseSubscriber

from ....schemas.wire.errors import (
    BucketNotFoundError,
    CredentialsRefusedError,
    ObjectNotFoundError,
    StorageError,
    StorageUnavailableError,
)
from ...files.whole_files import replaced
from ..aws_sessions import new_session
from ..checksums import compare, crc32_of, has_content, measure
from ..object_store import (
    WORKERS,
    WORKERS_FOR_SMALL,
    ObjectInfo,
    Stopped,
    Tell,
    UnfinishedUpload,
    check_bucket,
    check_key,
    check_prefix,
    never,
    put_each,
    refuse_stopped,
    tell_none,
)
from .failures import s3_failures
from .multipart import PartedUploads
from .quick_puts import QuickPuts

if TYPE_CHECKING:
    from types_boto3_s3 import S3Client
    from types_boto3_s3.literals import BucketLocationConstraintType as _Region
    from types_boto3_s3.type_defs import (
        CreateBucketRequestTypeDef,
        GetObjectOutputTypeDef,
        HeadObjectOutputTypeDef,
        PutObjectRequestTypeDef,
    )

_LARGE_BYTES = 16 << 20
_SMALL_BYTES = 1 << 20
_CONFLICTS = 5
_RESTARTS = 4
_PROBE_S = 4
# The last one is what a transfer makes of an object that is replaced between its parts.
_BROKEN_OFF = (ReadTimeoutError, ResponseStreamingError, IncompleteReadError, S3DownloadFailedError)


class _Session(Protocol):
    """Methods of a boto3 session that are used here; the stubs of `client` name services without installed stubs."""

    def client(
        self, service_name: Literal["s3"], *, region_name: str, endpoint_url: str | None, config: Config
    ) -> "S3Client": ...


class _Entry(TypedDict):
    """Members of a list entry that are used here; stubs call them optional, but every server sends them."""

    Key: str
    Size: int
    ETag: str
    LastModified: datetime


class _Upload(TypedDict):
    """Members of a multipart upload that are used here; stubs call them optional, but every server sends them."""

    Key: str
    UploadId: str
    Initiated: datetime


class S3Store:
    """Object store on an S3 server or AWS.

    Args:
        endpoint_url: The endpoint; None for AWS.
        region: The region to sign for.
        session: Boto3 session with the credentials; by default boto3's usual chain.
        attempts: How often a request is tried in all. The waits between ten attempts add up to about
            13 seconds on average, which outlasts a server's restart.
    """

    def __init__(
        self, endpoint_url: str | None, region: str, session: boto3.Session | None = None, *, attempts: int = 10
    ) -> None:
        config = Config(
            retries={"mode": "standard", "total_max_attempts": attempts},
            connect_timeout=5,
            read_timeout=60,
            max_pool_connections=WORKERS_FOR_SMALL,
            tcp_keepalive=True,
            # Only AWS has a host name for every bucket.
            s3={"addressing_style": "path"} if endpoint_url else {},
        )
        session = session or new_session()
        connect = cast("_Session", session).client
        self._client = connect("s3", region_name=region, endpoint_url=endpoint_url, config=config)
        self._quick = QuickPuts(self._client, endpoint_url, region, session) if endpoint_url else None
        self._parts = PartedUploads(self._client, self._quick)
        once = config.merge(Config(retries={"total_max_attempts": 1}, connect_timeout=_PROBE_S, read_timeout=_PROBE_S))
        self._connect_prober = lambda: connect("s3", region_name=region, endpoint_url=endpoint_url, config=once)
        self._probing: S3Client | None = None
        self._lock = threading.Lock()
        self._turns = threading.BoundedSemaphore(WORKERS)  # of files that fill memory
        self._region = region
        self._endpoint = endpoint_url or f"AWS S3 ({region})"
        downloads = TransferConfig(
            multipart_threshold=_LARGE_BYTES,
            multipart_chunksize=_LARGE_BYTES,
            max_concurrency=WORKERS,
            # The other one, chosen by itself where awscrt is installed, ignores the endpoint and writes to AWS.
            preferred_transfer_client="classic",
        )
        self._downloads = create_transfer_manager(self._client, downloads)

    def ensure_bucket(self, bucket: str) -> None:
        """Creates a bucket on the S3 server unless it exists.

        Raises:
            StorageAccessDeniedError: The credentials may not even ask; the bucket may exist all the same.
        """
        check_bucket(bucket)
        with self._failures(f"look for the bucket {bucket}"):
            if self._bucket_exists(bucket):
                return
        request: CreateBucketRequestTypeDef = {"Bucket": bucket}
        if self._region != "us-east-1":
            request["CreateBucketConfiguration"] = {"LocationConstraint": cast("_Region", self._region)}
        with self._failures(f"create the bucket {bucket}"):
            try:
                self._client.create_bucket(**request)
            except ClientError as error:
                if _code(error) != "BucketAlreadyOwnedByYou":  # another client was quicker
                    raise

    def check_credentials(self) -> None:
        """Checks that the server knows the credentials, whatever they allow.

        Raises:
            CredentialsRefusedError: The server does not know the credentials, or none are given.
            StorageUnavailableError: The server does not answer.
        """
        try:
            with self._failures("find out who one is"):
                self._client.list_buckets()  # unlike the answer to a HEAD, this one says what is wrong
        except (CredentialsRefusedError, StorageUnavailableError):
            raise
        except StorageError:
            return  # such as that these may not be listed

    def check_writable(self, bucket: str, key: str) -> None:
        """Checks that an object could be written, by beginning a multipart upload.

        Raises:
            StorageAccessDeniedError: The credentials do not allow it.
            BucketNotFoundError: The bucket does not exist.
        """
        _check(bucket, key)
        with self._failures(f"write {bucket}/{key}"):
            upload = self._client.create_multipart_upload(Bucket=bucket, Key=key)["UploadId"]
        with suppress(StorageError), self._failures(f"end an upload to {bucket}/{key}"):
            self._client.abort_multipart_upload(Bucket=bucket, Key=key, UploadId=upload)

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """Uploads a file as an object, and returns the object's metadata; checksums are verified.

        Raises:
            TransferStoppedError: `stopped` said so, and the object is as it was before.
            ChecksumMismatchError: The file was written to meanwhile, or the server has other bytes.
        """
        _check(bucket, key)
        with self._failures(f"store {path} as {bucket}/{key}"):
            size = path.stat().st_size
            with nullcontext() if size < _SMALL_BYTES else self._turns:
                refuse_stopped(stopped, bucket, key)
                if size < _LARGE_BYTES:
                    return self._put(bucket, key, path.read_bytes(), create_only=False)
                return self._put_large(bucket, key, path, stopped)

    def probe(self, bucket: str) -> None:
        """Checks quickly, with one request, whether the S3 server answers at all; any answer counts.

        Raises `StorageUnavailableError` if it does not answer; a missing bucket or a refusal is no error.
        """
        check_bucket(bucket)
        try:
            with self._failures(f"look for the bucket {bucket}"):
                self._prober().head_bucket(Bucket=bucket)
        except StorageUnavailableError:
            raise
        except StorageError:
            return  # that was an answer

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """Returns the stored object if it already has the same content as a local file, by checksum.

        Returns `None` if the object differs, does not exist, or may not be looked at.
        """
        _check(bucket, key)
        refuse_stopped(stopped, bucket, key)
        with self._failures(f"compare {path} with {bucket}/{key}"):
            try:
                answer = self._head(bucket, key)
            except ClientError as error:
                if _code(error) not in ("403", "AccessDenied"):  # who may put an object may not be allowed to look
                    raise
                return None
            except (ObjectNotFoundError, BucketNotFoundError):
                return None
            return _info(bucket, key, answer) if has_content(answer, path, stopped) else None

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """Uploads many files concurrently, and returns the stored objects in the order of the files.

        Raises the first error once running uploads have ended; further ones are not begun.
        """
        return put_each(self, bucket, files, stopped, tell, WORKERS_FOR_SMALL)

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """Writes bytes as an object, and returns its metadata; an existing one is replaced unless `create_only` is set.

        Raises:
            ObjectExistsError: `create_only` and something is there; after a broken connection it can
                be what this very call has written.
        """
        _check(bucket, key)
        with self._failures(f"store {bucket}/{key}"):
            return self._put(bucket, key, data, create_only=create_only)

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """Downloads an object to a file, which appears only when complete and its checksum is right; returns its facts.

        Raises `ObjectNotFoundError` if there is no such object, `ChecksumMismatchError` if the content is damaged, and
        `StorageError` otherwise; no part of the file is then left.
        """
        _check(bucket, key)
        with (
            self._failures(f"fetch {bucket}/{key} into {path}"),
            replaced(path) as part,
            part.open("xb+") as target,
        ):
            return self._fetch(bucket, key, target)

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """Returns the content of an object on the S3 server; raises `ObjectNotFoundError` if there is none."""
        _check(bucket, key)
        buffer = BytesIO()
        with self._failures(f"fetch {bucket}/{key}"):
            self._fetch(bucket, key, buffer)
        return buffer.getvalue()

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """Returns the metadata of an object on the S3 server; raises `ObjectNotFoundError` if there is none."""
        _check(bucket, key)
        with self._failures(f"read {bucket}/{key}"):
            return _info(bucket, key, self._head(bucket, key))

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """Lists objects whose keys start with `prefix`, in key order.

        The empty objects that S3 consoles make for folders (their keys end in `/`) are left out. All
        pages are read before the first object is given, as not every server keeps S3's order.
        """
        check_bucket(bucket)
        check_prefix(prefix)
        with self._failures(f"list {bucket}/{prefix}"):
            pages = self._client.get_paginator("list_objects_v2").paginate(Bucket=bucket, Prefix=prefix)
            found = [
                ObjectInfo(bucket, entry["Key"], entry["Size"], entry["ETag"].strip('"'), entry["LastModified"])
                for page in pages
                for entry in cast("Sequence[_Entry]", page.get("Contents", ()))
                if not entry["Key"].endswith("/")
            ]
        yield from sorted(found, key=lambda info: info.key.encode())

    def delete(self, bucket: str, key: str) -> None:
        """Deletes an object from the S3 server; succeeds if there is none."""
        _check(bucket, key)
        with self._failures(f"delete {bucket}/{key}"):
            self._client.delete_object(Bucket=bucket, Key=key)

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """Lists the multipart uploads to a bucket that began before a time and have not ended."""
        check_bucket(bucket)
        with self._failures(f"list unfinished uploads to {bucket}"):
            pages = self._client.get_paginator("list_multipart_uploads").paginate(Bucket=bucket)
            return [
                UnfinishedUpload(bucket, each["Key"], each["UploadId"], each["Initiated"])
                for page in pages
                for each in cast("Sequence[_Upload]", page.get("Uploads", ()))
                if each["Initiated"] < before
            ]

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """Deletes the parts of an unfinished upload; succeeds if there are none."""
        with self._failures(f"abort the upload of {upload.bucket}/{upload.key}"):
            try:
                self._client.abort_multipart_upload(Bucket=upload.bucket, Key=upload.key, UploadId=upload.upload_id)
            except ClientError as error:
                if _code(error) != "NoSuchUpload":
                    raise

    def uri(self, bucket: str, key: str) -> str:
        """Returns the object's `s3://…` URI."""
        return f"s3://{bucket}/{key}"

    def local_path(self, bucket: str, key: str) -> Path | None:  # noqa: ARG002 - the protocol's signature
        """Returns `None` for every object, as objects on an S3 server are no local files."""
        return None

    def _prober(self) -> "S3Client":
        """Returns a client with short time limits for probes, which is made on first use and then kept."""
        with self._lock:
            if self._probing is None:
                self._probing = self._connect_prober()
            return self._probing

    def _failures(self, doing: str) -> AbstractContextManager[None]:
        return s3_failures(doing, self._endpoint)

    def _bucket_exists(self, bucket: str) -> bool:
        try:
            self._client.head_bucket(Bucket=bucket)
        except ClientError as error:
            if _code(error) in ("404", "NoSuchBucket", "NotFound"):
                return False
            raise
        return True

    def _put(self, bucket: str, key: str, data: bytes, *, create_only: bool) -> ObjectInfo:
        crc = crc32_of(data)
        if self._quick and not create_only and (stored := self._quick.put(bucket, key, data, crc)):
            return ObjectInfo(bucket, key, len(data), stored.etag)
        request: PutObjectRequestTypeDef = {"Bucket": bucket, "Key": key, "Body": data, "ChecksumCRC32": crc}
        if create_only:
            request["IfNoneMatch"] = "*"
        for last in [False] * _CONFLICTS + [True]:
            try:
                answer = self._client.put_object(**request)
            except ClientError as error:
                # Two conditional writes met: S3 asks to try again, and then one of them finds the other's object.
                if _code(error) != "ConditionalRequestConflict" or last:
                    raise
            else:
                return ObjectInfo(bucket, key, len(data), answer["ETag"].strip('"'))
        raise AssertionError("the last attempt returns or raises")

    def _put_large(self, bucket: str, key: str, path: Path, stopped: Stopped) -> ObjectInfo:
        size, crc = self._parts.upload(bucket, key, path, stopped)
        answer = self._head(bucket, key)
        compare(answer, size, crc, f"{bucket}/{key} as stored at {self._endpoint}")
        return _info(bucket, key, answer)

    def _head(self, bucket: str, key: str) -> "HeadObjectOutputTypeDef":
        try:
            return self._client.head_object(Bucket=bucket, Key=key, ChecksumMode="ENABLED")
        except ClientError as error:
            if _code(error) != "404":
                raise
            # The answer has no body that would tell a missing bucket from a missing object.
            if not self._bucket_exists(bucket):
                raise BucketNotFoundError(f"there is no bucket {bucket!r} at {self._endpoint}") from error
            raise ObjectNotFoundError(f"there is no object {key!r} in bucket {bucket!r} at {self._endpoint}") from error

    def _fetch(self, bucket: str, key: str, target: BinaryIO) -> ObjectInfo:
        """Downloads one version of an object into an open file, and returns what is known of that version.

        Starts again, from an empty file, if the object is replaced or the connection breaks meanwhile; raises the error
        of the last attempt.
        """
        for last in [False] * _RESTARTS + [True]:
            target.seek(0)
            target.truncate()
            answer = self._client.get_object(Bucket=bucket, Key=key, ChecksumMode="ENABLED")
            try:
                self._receive(bucket, key, answer, target)
            except _BROKEN_OFF:
                if last:
                    raise
            else:
                return _info(bucket, key, answer)
        raise AssertionError("the last attempt returns or raises")

    def _receive(self, bucket: str, key: str, answer: "GetObjectOutputTypeDef", target: BinaryIO) -> None:
        """Writes the content of the object version that an answer describes to an open file, and checks its checksum.

        Small objects are read from the answer itself; large ones are fetched as parts, concurrently. Raises
        `ChecksumMismatchError` if the content is damaged.
        """
        # Not `with answer["Body"]`: that gives the raw stream, which compares and translates nothing.
        with closing(answer["Body"]) as body:
            if answer["ContentLength"] < _LARGE_BYTES:
                target.write(body.read())  # here the client itself compares the checksum
                return
        self._downloads.download(bucket, key, target, subscribers=[_Known(answer)]).result()
        target.seek(0)
        compare(answer, *measure(target), f"{bucket}/{key} as fetched from {self._endpoint}")


class _Known(BaseSubscriber):
    """Passes an object's known size and ETag to boto3's transfer, so that it sends no request for them."""

    def __init__(self, answer: "GetObjectOutputTypeDef") -> None:
        self._answer = answer

    def on_queued(self, future: Any, **kwargs: Any) -> None:  # noqa: ARG002 - s3transfer's signature
        future.meta.provide_transfer_size(self._answer["ContentLength"])
        future.meta.provide_object_etag(self._answer["ETag"])


def _check(bucket: str, key: str) -> None:
    check_bucket(bucket)
    check_key(key)


def _info(bucket: str, key: str, answer: "GetObjectOutputTypeDef | HeadObjectOutputTypeDef") -> ObjectInfo:
    return ObjectInfo(bucket, key, answer["ContentLength"], answer["ETag"].strip('"'), answer["LastModified"])


def _code(error: ClientError) -> str:
    return error.response.get("Error", {}).get("Code", "")
