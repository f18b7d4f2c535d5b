"""Small objects past boto3's client: signed as botocore signs, checked by the server, else left to the client."""

import base64
import threading
import zlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from botocore import auth
from botocore.auth import S3SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.credentials import ReadOnlyCredentials
from botocore.exceptions import ReadTimeoutError
from helpers.fault_proxy import in_between
from helpers.processes import wait_for
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.storage.aws_sessions import new_session
from prefect_robomaker.tasks.storage.checksums import crc32_of
from prefect_robomaker.tasks.storage.object_store import WORKERS, WORKERS_FOR_SMALL, ObjectInfo
from prefect_robomaker.tasks.storage.s3 import S3Store
from prefect_robomaker.tasks.storage.s3.quick_puts import QuickPuts

BUCKET = "quick-puts"
NOW = datetime(2026, 3, 2, 4, 5, 6, tzinfo=UTC)


@pytest.fixture
def store(s3_server: S3Server) -> S3Store:
    store = S3Store(s3_server.endpoint, "us-east-1", s3_server.session())
    store.ensure_bucket(BUCKET)
    return store


@pytest.fixture
def client_puts(store: S3Store) -> list[str]:
    """The puts that boto3's client makes."""
    seen: list[str] = []
    events: Any = store._client.meta.events
    events.register("before-send.s3.PutObject", lambda request, **_: seen.append(request.url))
    return seen


def quick(store: S3Store) -> QuickPuts:
    assert store._quick is not None
    return store._quick


@pytest.mark.parametrize("token", [None, "a/token=="])
@pytest.mark.parametrize(
    "endpoint", ["http://127.0.0.1:9000", "https://s3.example.com:443", "http://[::1]:80", "http://s3.example.com"]
)
@pytest.mark.parametrize("data", [b"", b"content"])
@pytest.mark.parametrize("query", ["", "partNumber=12&uploadId=a%2Fb~c"])
def test_it_signs_as_botocore_does(
    endpoint: str, token: str | None, data: bytes, query: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys: Any = ReadOnlyCredentials("key", "secret+/", token)
    session = new_session("key", "secret")
    store = S3Store(endpoint, "eu-west-1", session)
    path = "/bucket/a%20b/%C3%BC~%2B"
    ours = quick(store).signed(path, data, crc32_of(data), keys, NOW, query)

    monkeypatch.setattr(auth, "get_current_datetime", lambda: NOW)
    url = endpoint + path + (f"?{query}" if query else "")
    request = AWSRequest("PUT", url, headers={"x-amz-checksum-crc32": ours["x-amz-checksum-crc32"]}, data=data)
    S3SigV4Auth(keys, "s3", "eu-west-1").add_auth(request)
    assert ours["Authorization"] == request.headers["Authorization"]
    assert ours.get("x-amz-security-token") == token


def test_small_files_go_past_the_client_with_their_checksum(
    store: S3Store, s3_server: S3Server, client_puts: list[str], tmp_path: Path
) -> None:
    keys = ["plain", "a b/ü+~(1)&=.bin", "empty"]
    files = {key: tmp_path / str(number) for number, key in enumerate(keys)}
    for key, path in files.items():
        path.write_bytes(b"" if key == "empty" else key.encode() * 1000)
    infos = store.put_files(BUCKET, files)

    assert client_puts == []
    for info, (key, path) in zip(infos, files.items(), strict=True):
        assert info == store.head(BUCKET, key)
        assert store.get_bytes(BUCKET, key) == path.read_bytes()
        seen = s3_server.client("s3").head_object(Bucket=BUCKET, Key=key, ChecksumMode="ENABLED")
        assert base64.b64decode(seen["ChecksumCRC32"]) == zlib.crc32(path.read_bytes()).to_bytes(4, "big")


def test_the_server_refuses_other_content(store: S3Store) -> None:
    assert quick(store).put(BUCKET, "torn", b"content", "AAAAAA==") is None
    with pytest.raises(ObjectNotFoundError):
        store.head(BUCKET, "torn")


def test_what_the_server_does_not_answer_well_is_tried_again(s3_server: S3Server, store: S3Store) -> None:
    results: list[ObjectInfo] = []
    with in_between(s3_server.endpoint) as proxy:
        shaky = S3Store(proxy.endpoint, "us-east-1", s3_server.session())
        proxy.answer(503, "SlowDown")
        thread = threading.Thread(target=lambda: results.append(shaky.put_bytes(BUCKET, "shaky", b"content")))
        thread.start()
        wait_for(lambda: proxy.refused >= 2, "two refusals")
        proxy.pass_on()
        thread.join(240)
    assert results == [store.head(BUCKET, "shaky")]


def test_a_broken_connection_is_left_to_the_client(
    store: S3Store, client_puts: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Broken:
        def send(self, request: Any) -> Any:
            raise ReadTimeoutError(endpoint_url=request.url)

    monkeypatch.setattr(quick(store), "_http", Broken())
    store.put_bytes(BUCKET, "broken", b"content")
    assert len(client_puts) == 1
    assert store.get_bytes(BUCKET, "broken") == b"content"


def test_where_the_connections_of_a_client_are_elsewhere_it_stores_all(
    store: S3Store, client_puts: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    client: Any = Mock(spec=["meta"])  # as of a release that has them under another name
    made = QuickPuts(client, store._client.meta.endpoint_url, "us-east-1", new_session("key", "secret"))
    monkeypatch.setattr(store, "_quick", made)
    store.put_bytes(BUCKET, "elsewhere", b"content")
    assert len(client_puts) == 1


def test_each_put_is_signed_with_the_credentials_of_its_moment(store: S3Store, monkeypatch: pytest.MonkeyPatch) -> None:
    signers: list[str] = []

    class Answer:
        def __init__(self) -> None:
            self.status_code = 200
            self.headers = {"ETag": '"etag"'}

    class Http:
        def send(self, request: Any) -> Answer:
            signers.append(request.headers["Authorization"].partition("Credential=")[2].partition("/")[0])
            return Answer()

    class Rolling:
        def get_frozen_credentials(self) -> ReadOnlyCredentials:
            return ReadOnlyCredentials(f"key-{len(signers)}", "secret", None)

    monkeypatch.setattr(quick(store), "_http", Http())
    monkeypatch.setattr(quick(store)._session, "get_credentials", Rolling)
    for _ in range(2):
        assert store.put_bytes(BUCKET, "rolling", b"").etag == "etag"
    assert signers == ["key-0", "key-1"]


@pytest.mark.parametrize(("size", "most"), [(10_000, WORKERS_FOR_SMALL), (1 << 20, WORKERS)])
def test_files_that_fill_memory_go_a_few_at_a_time(
    store: S3Store, tmp_path: Path, size: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, now, seen, all_are_there = threading.Lock(), [0], list[int](), threading.Event()

    def counted(bucket: str, key: str, *_: Any, **members: Any) -> ObjectInfo:
        with lock:
            now[0] += 1
            seen.append(now[0])
        if now[0] == most:
            threading.Timer(0.2, all_are_there.set).start()  # one too many has the time to come
        assert all_are_there.wait(120)
        with lock:
            now[0] -= 1
        return ObjectInfo(bucket=bucket, key=key, size_bytes=size, etag="etag")

    monkeypatch.setattr(store, "_put", counted)
    (tmp_path / "file").write_bytes(bytes(size))
    store.put_files(BUCKET, {f"at-once/{number}": tmp_path / "file" for number in range(2 * most)})
    assert max(seen) == most
