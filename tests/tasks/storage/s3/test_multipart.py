"""Large objects in parts on a real S3 server: under the CRC32 of the whole, and nothing of what was not wanted."""

import base64
import threading
import zlib
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import pytest
from botocore.exceptions import ClientError
from helpers.fault_proxy import in_between
from helpers.processes import wait_for
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.wire.errors import (
    ChecksumMismatchError,
    ObjectNotFoundError,
    StorageError,
    TransferStoppedError,
)
from prefect_robomaker.tasks.storage.aws_sessions import new_session
from prefect_robomaker.tasks.storage.s3 import S3Store, multipart
from prefect_robomaker.tasks.storage.s3.multipart import PART_BYTES, _Body

BUCKET = "s3-parts"
LARGE = bytes(range(256)) * 80_000
"""Two whole parts and one that is smaller."""


@pytest.fixture
def s3(s3_store: S3Store) -> S3Store:
    s3_store.ensure_bucket(BUCKET)
    return s3_store


@pytest.fixture
def large(tmp_path: Path) -> Path:
    path = tmp_path / "large"
    path.write_bytes(LARGE)
    return path


@pytest.fixture
def parts_of_client(s3: S3Store) -> list[str]:
    """The parts that boto3's client sends."""
    seen: list[str] = []
    events: Any = s3._client.meta.events
    events.register("before-send.s3.UploadPart", lambda request, **_: seen.append(request.url))
    return seen


def unfinished(server: S3Server) -> bool:
    return bool(server.client("s3").list_multipart_uploads(Bucket=BUCKET).get("Uploads"))


@pytest.mark.parametrize(
    ("quick", "key"),
    [
        (True, "a b/ü+~(1)&=.bin"),
        (False, "plain"),
        pytest.param(True, "plain", marks=pytest.mark.deep),
        pytest.param(False, "a b/ü+~(1)&=.bin", marks=pytest.mark.deep),
    ],
)
def test_large_objects_carry_the_crc32_of_the_whole(
    s3: S3Store,
    s3_server: S3Server,
    large: Path,
    parts_of_client: list[str],
    key: str,
    quick: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not quick:
        monkeypatch.setattr(s3._parts, "_quick", None)  # as for AWS
    info = s3.put_file(BUCKET, key, large)

    assert len(parts_of_client) == (0 if quick else 3)
    assert info == s3.head(BUCKET, key)
    assert s3.get_bytes(BUCKET, key) == LARGE
    seen = s3_server.client("s3").head_object(Bucket=BUCKET, Key=key, ChecksumMode="ENABLED")
    assert seen["ETag"].endswith('-3"'), "three parts"
    assert seen.get("ChecksumType") == "FULL_OBJECT"
    assert base64.b64decode(seen["ChecksumCRC32"]) == zlib.crc32(LARGE).to_bytes(4, "big")


def test_no_object_has_more_parts_than_s3_takes(
    s3: S3Store, s3_server: S3Server, large: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multipart, "_MOST_PARTS", 2)
    s3.put_file(BUCKET, "few", large)
    assert s3_server.client("s3").head_object(Bucket=BUCKET, Key="few")["ETag"].endswith('-2"')
    assert s3.get_bytes(BUCKET, "few") == LARGE


def test_parts_that_are_not_answered_well_are_left_to_the_client(s3_server: S3Server, s3: S3Store, large: Path) -> None:
    stored: list[Any] = []
    with in_between(s3_server.endpoint) as proxy:
        shaky = S3Store(proxy.endpoint, "us-east-1", s3_server.session())
        proxy.answer(503, "SlowDown", after_puts=1)
        thread = threading.Thread(target=lambda: stored.append(shaky.put_file(BUCKET, "shaky", large)))
        thread.start()
        wait_for(lambda: proxy.refused >= 2, "two refusals")
        proxy.pass_on()
        thread.join(240)
    assert stored == [s3.head(BUCKET, "shaky")]
    assert s3.get_bytes(BUCKET, "shaky") == LARGE


def test_a_stopped_upload_leaves_no_parts_at_the_server(s3: S3Store, s3_server: S3Server, large: Path) -> None:
    large.write_bytes(LARGE * 3)
    with pytest.raises(TransferStoppedError, match="stopped"):
        s3.put_file(BUCKET, "stopped", large, stopped=lambda: unfinished(s3_server))

    assert not unfinished(s3_server)
    with pytest.raises(ObjectNotFoundError):
        s3.head(BUCKET, "stopped")


def test_a_part_that_is_being_sent_is_not_sent_to_its_end(
    s3: S3Store, s3_server: S3Server, large: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, read = threading.Event(), threading.Event()

    def slowly(data: bytes, stopped: Any) -> Any:
        """As over a slow connection."""
        for start in range(0, len(data), 1024):
            if stopped():
                read.set()
                raise CancelledError
            begun.set()
            threading.Event().wait(0.05)
            yield data[start : start + 1024]

    monkeypatch.setattr("prefect_robomaker.tasks.storage.s3.quick_puts._pieces", slowly)
    with pytest.raises(TransferStoppedError):
        s3.put_file(BUCKET, "slow", large, stopped=begun.is_set)
    assert read.is_set()
    assert not unfinished(s3_server)


def test_a_body_of_the_client_is_not_read_further_when_it_is_not_wanted() -> None:
    over = threading.Event()
    body = _Body(b"content", over)
    assert body.read(3) == b"con"
    over.set()
    with pytest.raises(CancelledError):
        body.read(3)


@pytest.mark.parametrize(
    ("at", "more"),
    [
        (len(LARGE) - 1, b"!"),
        pytest.param(0, b"!", marks=pytest.mark.deep),
        pytest.param(len(LARGE), b"more", marks=pytest.mark.deep),
        (PART_BYTES // 2, b""),
    ],
)
def test_a_file_written_to_during_its_upload_is_not_stored(
    s3: S3Store, s3_server: S3Server, large: Path, monkeypatch: pytest.MonkeyPatch, at: int, more: bytes
) -> None:
    send = s3._parts._send

    def change_and_send(upload: Any, number: int, *place: int) -> Any:
        if number == 1:
            with large.open("r+b") as file:
                file.seek(at)
                file.write(more) if more else file.truncate()
        return send(upload, number, *place)

    monkeypatch.setattr(s3._parts, "_send", change_and_send)
    with pytest.raises(ChecksumMismatchError, match="while it was stored as s3-parts/torn"):
        s3.put_file(BUCKET, "torn", large)
    assert not unfinished(s3_server)
    with pytest.raises(ObjectNotFoundError):
        s3.head(BUCKET, "torn")


def test_a_part_that_arrives_damaged_is_refused(
    s3: S3Store, s3_server: S3Server, large: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multipart, "crc32_text", lambda crc: "AAAAAA==")
    with pytest.raises(StorageError):
        s3.put_file(BUCKET, "damaged", large)
    assert not unfinished(s3_server)


def test_parts_of_another_order_are_refused_by_the_checksum_of_the_whole(
    s3: S3Store, s3_server: S3Server, large: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multipart, "crc32_of_parts", lambda each: "AAAAAA==")
    with pytest.raises(StorageError):
        s3.put_file(BUCKET, "mixed-up", large)
    assert not unfinished(s3_server)


def test_a_lost_answer_to_the_completion_of_an_upload_is_no_failure(
    s3: S3Store, large: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some servers answer a repeated completion with NoSuchUpload; then what is stored decides."""
    answer: Any = {"Error": {"Code": "NoSuchUpload", "Message": "gone"}, "ResponseMetadata": {"HTTPStatusCode": 404}}
    complete = s3._client.complete_multipart_upload

    def complete_and_lose_the_answer(**request: Any) -> Any:
        complete(**request)
        raise ClientError(answer, "CompleteMultipartUpload")

    monkeypatch.setattr(s3._client, "complete_multipart_upload", complete_and_lose_the_answer)
    assert s3.put_file(BUCKET, "completed", large) == s3.head(BUCKET, "completed")
    large.write_bytes(LARGE[::-1])

    def lose_the_upload(**request: Any) -> Any:
        s3._client.abort_multipart_upload(**{name: request[name] for name in ("Bucket", "Key", "UploadId")})
        raise ClientError(answer, "CompleteMultipartUpload")

    monkeypatch.setattr(s3._client, "complete_multipart_upload", lose_the_upload)
    with pytest.raises(ChecksumMismatchError, match="completed"):
        s3.put_file(BUCKET, "completed", large)


def test_a_server_that_cannot_be_reached_leaves_the_first_error(tmp_path: Path, large: Path) -> None:
    store = S3Store("http://127.0.0.1:9", "us-east-1", new_session("key", "secret"), attempts=1)
    with pytest.raises(StorageError, match="Could not connect"):
        store.put_file(BUCKET, "nowhere", large)
