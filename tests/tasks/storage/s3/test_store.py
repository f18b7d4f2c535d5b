"""What is particular to S3: credentials, endpoints, checksums of large objects, broken connections."""

import io
import json
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import boto3
import pytest
from botocore.awsrequest import AWSResponse
from botocore.exceptions import ClientError
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.wire.errors import (
    BucketNotFoundError,
    ChecksumMismatchError,
    CredentialsRefusedError,
    ObjectExistsError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
    StorageFullError,
    StorageUnavailableError,
)
from prefect_robomaker.tasks.storage.aws_sessions import new_session
from prefect_robomaker.tasks.storage.s3 import S3Store
from prefect_robomaker.tasks.storage.s3.failures import from_client_error

BUCKET = "s3-tests"
LARGE = bytes(range(256)) * 67_000
"""So large that it goes in parts."""


@pytest.fixture
def s3(s3_store: S3Store) -> S3Store:
    s3_store.ensure_bucket(BUCKET)
    return s3_store


def store_of(server: S3Server, key: str, secret: str) -> S3Store:
    return S3Store(server.endpoint, "us-east-1", new_session(key, secret), attempts=2)


def test_uri_and_no_local_path(s3: S3Store):
    assert s3.uri("bucket", "a/b") == "s3://bucket/a/b"
    assert s3.local_path("bucket", "a/b") is None


@pytest.mark.parametrize(("conflicts", "stored"), [(2, True), (100, False)])
def test_conflicting_conditional_writes_are_tried_again(s3_server: S3Server, conflicts: int, stored: bool):
    store = S3Store(s3_server.endpoint, "us-east-1", s3_server.session())
    store.ensure_bucket(BUCKET)
    key = f"conflict-{conflicts}"
    left = [conflicts]

    def answer_conflict(request: Any, **kwargs: object) -> Any:
        if left[0] == 0:
            return None
        left[0] -= 1
        body = b"<Error><Code>ConditionalRequestConflict</Code><Message>try again</Message></Error>"
        headers: Any = {}
        return AWSResponse(request.url, 409, headers, RawResponse(body))

    events: Any = store._client.meta.events  # its stubs know no hook that answers
    events.register("before-send.s3.PutObject", answer_conflict)
    if stored:
        store.put_bytes(BUCKET, key, b"content", create_only=True)
        assert store.get_bytes(BUCKET, key) == b"content"
    else:
        with pytest.raises(StorageError, match="ConditionalRequestConflict"):
            store.put_bytes(BUCKET, key, b"content", create_only=True)


class RawResponse(io.BytesIO):
    """A body as botocore reads it."""

    def stream(self, **kwargs: object) -> Iterator[bytes]:
        while chunk := self.read():
            yield chunk


def test_a_large_object_replaced_while_it_is_fetched_arrives_in_one_version(
    s3: S3Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "old").write_bytes(LARGE)
    (tmp_path / "new").write_bytes(LARGE[::-1])
    s3.put_file(BUCKET, "replaced", tmp_path / "old")
    download = s3._downloads.download

    def replace_and_download(*args, **kwargs):
        monkeypatch.undo()
        s3.put_file(BUCKET, "replaced", tmp_path / "new")
        return download(*args, **kwargs)

    monkeypatch.setattr(s3._downloads, "download", replace_and_download)
    info = s3.get_file(BUCKET, "replaced", tmp_path / "fetched")
    assert (tmp_path / "fetched").read_bytes() == LARGE[::-1]
    assert info == s3.head(BUCKET, "replaced")


def test_a_small_object_that_arrives_damaged_is_refused(s3: S3Store, s3_server: S3Server, tmp_path: Path):
    content = b"content" * 1000
    s3.put_bytes(BUCKET, "damaged", content)
    proxy = CuttingProxy(s3_server, cuts=0, after_bytes=0, upwards=False, replace=(content[-70:], b"damaged" * 10))
    store = S3Store(proxy.endpoint, "us-east-1", s3_server.session())
    for call in (store.get_bytes, lambda bucket, key: store.get_file(bucket, key, tmp_path / "fetched")):
        with pytest.raises(ChecksumMismatchError, match="damaged"):
            call(BUCKET, "damaged")
    proxy.close()
    assert list(tmp_path.iterdir()) == []


def test_listing_goes_on_past_one_page(s3: S3Store, s3_server: S3Server):
    keys = [f"pages/{index:02}" for index in range(10)]
    for key in keys:
        s3.put_bytes(BUCKET, key, b"")
    store = S3Store(s3_server.endpoint, "us-east-1", s3_server.session())
    pages = []

    def small_pages(params: dict, **kwargs: object) -> dict:
        pages.append(params)
        return {**params, "MaxKeys": 3}

    events: Any = store._client.meta.events
    events.register("provide-client-params.s3.ListObjectsV2", small_pages)
    assert [info.key for info in store.list(BUCKET, "pages/")] == keys
    assert len(pages) == 4


def test_folder_markers_of_consoles_are_no_objects(s3: S3Store, s3_server: S3Server):
    s3_server.client("s3").put_object(Bucket=BUCKET, Key="marked/", Body=b"")
    s3.put_bytes(BUCKET, "marked/object", b"")
    assert [info.key for info in s3.list(BUCKET, "marked/")] == ["marked/object"]


@pytest.mark.parametrize(("key", "secret"), [(None, "wrong"), ("nobody", "wrong")], ids=["secret", "user"])
def test_wrong_credentials_are_denied(s3: S3Store, s3_server: S3Server, key: str | None, secret: str, tmp_path: Path):
    stranger = store_of(s3_server, key or s3_server.access_key, secret)
    (tmp_path / "file").write_bytes(b"")
    calls = [
        lambda: stranger.put_bytes(BUCKET, "a", b""),
        lambda: stranger.put_file(BUCKET, "a", tmp_path / "file"),
        lambda: stranger.get_bytes(BUCKET, "a"),
        lambda: stranger.head(BUCKET, "a"),
        lambda: list(stranger.list(BUCKET)),
        lambda: stranger.delete(BUCKET, "a"),
        lambda: stranger.ensure_bucket(BUCKET),
    ]
    for call in calls:
        with pytest.raises(StorageAccessDeniedError, match=BUCKET):
            call()


@pytest.fixture(scope="module")
def limited_store(s3_server: S3Server) -> S3Store:
    """A store of a user who may read and write below `mine/` and nothing else."""
    iam = s3_server.client("iam")
    iam.create_user(UserName="limited")
    keys = iam.create_access_key(UserName="limited")["AccessKey"]
    allowed = {
        "Effect": "Allow",
        "Action": ["s3:PutObject", "s3:GetObject"],
        "Resource": f"arn:aws:s3:::{BUCKET}/mine/*",
    }
    policy = json.dumps({"Version": "2012-10-17", "Statement": [allowed]})
    iam.put_user_policy(UserName="limited", PolicyName="mine", PolicyDocument=policy)
    return store_of(s3_server, keys["AccessKeyId"], keys["SecretAccessKey"])


def test_a_user_may_write_where_the_policy_says_and_nowhere_else(s3: S3Store, limited_store: S3Store, tmp_path: Path):
    (tmp_path / "large").write_bytes(LARGE)
    s3.put_bytes(BUCKET, "theirs/secret", b"secret")
    limited_store.put_bytes(BUCKET, "mine/small", b"content")
    limited_store.put_file(BUCKET, "mine/large", tmp_path / "large")
    assert limited_store.get_bytes(BUCKET, "mine/small") == b"content"
    for call in (
        lambda: limited_store.put_bytes(BUCKET, "theirs/new", b""),
        lambda: limited_store.put_file(BUCKET, "theirs/large", tmp_path / "large"),
        lambda: limited_store.get_bytes(BUCKET, "theirs/secret"),
        lambda: limited_store.delete(BUCKET, "theirs/secret"),
    ):
        with pytest.raises(StorageAccessDeniedError, match="theirs"):
            call()
    assert s3.get_bytes(BUCKET, "theirs/secret") == b"secret"


def test_no_credentials_at_all_says_what_to_set(s3_server: S3Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    with pytest.raises(StorageAccessDeniedError, match="AWS_ACCESS_KEY_ID"):
        S3Store(s3_server.endpoint, "us-east-1", boto3.Session()).head(BUCKET, "a")


def test_an_endpoint_that_does_not_answer_is_named(tmp_path: Path):
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))  # bound but not listening: connections are refused
        endpoint = f"http://127.0.0.1:{held.getsockname()[1]}"
        store = S3Store(endpoint, "us-east-1", new_session("key", "secret"), attempts=2)
        (tmp_path / "large").write_bytes(LARGE)
        for call in (
            lambda: store.head(BUCKET, "a"),
            lambda: store.put_file(BUCKET, "large", tmp_path / "large"),
            lambda: store.ensure_bucket(BUCKET),
        ):
            with pytest.raises(StorageUnavailableError, match=endpoint):
                call()
        with pytest.raises(StorageUnavailableError, match=endpoint):
            store.probe(BUCKET)


class CuttingProxy:
    """Passes connections on, cuts the first ones after some bytes in one direction, or replaces bytes in it."""

    def __init__(
        self,
        server: S3Server,
        *,
        cuts: int,
        after_bytes: int,
        upwards: bool,
        replace: tuple[bytes, bytes] = (b"", b""),
    ) -> None:
        self._replace = replace
        self._target = ("127.0.0.1", int(server.endpoint.rpartition(":")[2]))
        self._cuts, self._after_bytes, self._upwards = cuts, after_bytes, upwards
        self._lock = threading.Lock()
        self.cut = 0
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._target)
                for pair, upwards in (((client, server), True), ((server, client), False)):
                    threading.Thread(target=self._pump, args=(*pair, upwards), daemon=True).start()

    def _pump(self, source: socket.socket, target: socket.socket, upwards: bool) -> None:
        passed = 0
        with source, target, suppress(OSError):
            while data := source.recv(65536):
                target.sendall(
                    data.replace(*self._replace) if upwards == self._upwards and any(self._replace) else data
                )
                passed += len(data)
                with self._lock:
                    if upwards == self._upwards and passed > self._after_bytes and self.cut < self._cuts:
                        self.cut += 1
                        break
            for one in (source, target):
                one.shutdown(socket.SHUT_RDWR)


@pytest.fixture
def cutting_proxy(s3_server: S3Server, request: pytest.FixtureRequest) -> Iterator[CuttingProxy]:
    proxy = CuttingProxy(s3_server, **request.param)
    yield proxy
    proxy.close()


@pytest.mark.parametrize(
    "cutting_proxy", [{"cuts": 3, "after_bytes": 3_000_000, "upwards": True}], indirect=True, ids=["upload"]
)
def test_an_upload_survives_broken_connections(
    s3: S3Store, s3_server: S3Server, cutting_proxy: CuttingProxy, tmp_path: Path
):
    store = S3Store(cutting_proxy.endpoint, "us-east-1", s3_server.session())
    (tmp_path / "large").write_bytes(LARGE)
    store.put_file(BUCKET, "shaky/large", tmp_path / "large")
    store.put_bytes(BUCKET, "shaky/small", LARGE[:4_000_000])
    assert cutting_proxy.cut == 3
    assert s3.get_bytes(BUCKET, "shaky/large") == LARGE
    assert s3.get_bytes(BUCKET, "shaky/small") == LARGE[:4_000_000]


@pytest.mark.parametrize("size", [4_000_000, len(LARGE)], ids=["small", "large"])
@pytest.mark.parametrize(
    "cutting_proxy", [{"cuts": 2, "after_bytes": 3_000_000, "upwards": False}], indirect=True, ids=["download"]
)
def test_a_download_survives_broken_connections(
    s3: S3Store, s3_server: S3Server, cutting_proxy: CuttingProxy, tmp_path: Path, size: int
):
    (tmp_path / "sent").write_bytes(LARGE[:size])
    s3.put_file(BUCKET, "shaky/read", tmp_path / "sent")
    store = S3Store(cutting_proxy.endpoint, "us-east-1", s3_server.session())
    store.get_file(BUCKET, "shaky/read", tmp_path / "fetched")
    assert cutting_proxy.cut == 2
    assert (tmp_path / "fetched").read_bytes() == LARGE[:size]


def test_a_download_that_never_succeeds_leaves_nothing(s3: S3Store, s3_server: S3Server, tmp_path: Path):
    s3.put_bytes(BUCKET, "unreadable", LARGE[:4_000_000])
    proxy = CuttingProxy(s3_server, cuts=1000, after_bytes=1_000_000, upwards=False)
    store = S3Store(proxy.endpoint, "us-east-1", s3_server.session())
    with pytest.raises(StorageError, match="unreadable"):
        store.get_file(BUCKET, "unreadable", tmp_path / "fetched")
    proxy.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("code", "status", "kind"),
    [
        ("NoSuchBucket", 404, BucketNotFoundError),
        ("NoSuchKey", 404, ObjectNotFoundError),
        ("PreconditionFailed", 412, ObjectExistsError),
        ("AccessDenied", 403, StorageAccessDeniedError),
        ("AllAccessDisabled", 403, StorageAccessDeniedError),
        ("BadDigest", 400, ChecksumMismatchError),
        ("XAmzContentChecksumMismatch", 400, ChecksumMismatchError),
        ("XMinioStorageFull", 507, StorageFullError),
        ("InsufficientStorage", 507, StorageFullError),
        ("SomethingNew", 507, StorageFullError),
        ("InternalError", 500, StorageUnavailableError),
        ("SlowDown", 503, StorageUnavailableError),
        ("503", 503, StorageUnavailableError),
        ("XMinioServerNotInitialized", 503, StorageUnavailableError),
        ("BadGateway", 502, StorageUnavailableError),
        ("GatewayTimeout", 504, StorageUnavailableError),
        ("RequestTimeout", 400, StorageUnavailableError),
        ("RequestTimeTooSkewed", 403, StorageUnavailableError),
        ("InvalidAccessKeyId", 403, CredentialsRefusedError),
        ("MethodNotAllowed", 405, StorageError),
    ],
)
def test_answers_of_any_server_become_our_errors(code: str, status: int, kind: type[StorageError]):
    """Codes of servers that no test has at hand, as their documentation and sources give them."""
    answer: Any = {"Error": {"Code": code, "Message": "why"}, "ResponseMetadata": {"HTTPStatusCode": status}}
    error = from_client_error(ClientError(answer, "PutObject"), "cannot store a/b at http://s3")
    assert type(error) is kind
    assert str(error) == f"cannot store a/b at http://s3: {code}: why"


def test_who_uses_no_s3_does_not_import_its_client():
    code = (
        "import sys, prefect_robomaker.tasks.storage as s; from prefect_robomaker.schemas.settings import Settings;"
        "s.open_store(Settings.from_environment({'ROBOMAKER_HOME': '/nowhere'}), {});"
        "sys.exit(bool({'boto3', 'botocore', 'prefect'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
