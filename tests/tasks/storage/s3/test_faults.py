"""Large files on a real S3 server through deaths, storms and wrong clocks: whole, or not there; parts left over go."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.fault_proxy import FaultProxy, in_between
from helpers.local_agents import NEEDS_COMPILER, clock_environ
from helpers.processes import wait_for
from helpers.s3_server import MortalS3Server, S3Server

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageUnavailableError
from prefect_robomaker.tasks.storage.s3 import S3Store
from prefect_robomaker.tasks.storage.s3.multipart import PART_BYTES

pytestmark = pytest.mark.deep
BUCKET, KEY = "s3-faults", "runs/large.mcap"
SIZE = 5 * PART_BYTES
"""Five parts."""

UPLOAD = f"""
import sys
from pathlib import Path
import boto3
from prefect_robomaker.tasks.storage.s3 import S3Store
endpoint, file = sys.argv[1:]
S3Store(endpoint, "us-east-1", boto3.Session()).put_file({BUCKET!r}, {KEY!r}, Path(file))
"""


@pytest.fixture
def large(tmp_path: Path) -> Path:
    path = tmp_path / "large.mcap"
    path.write_bytes(os.urandom(1 << 20) * (SIZE >> 20))
    return path


@pytest.fixture
def proxy(mortal_s3: MortalS3Server) -> Iterator[FaultProxy]:
    mortal_s3.server.client("s3").create_bucket(Bucket=BUCKET)
    with in_between(mortal_s3.server.endpoint) as proxy:
        yield proxy


def store_at(endpoint: str, server: S3Server, attempts: int = 30) -> S3Store:
    return S3Store(endpoint, "us-east-1", server.session(), attempts=attempts)


def uploading(store: S3Store, file: Path) -> tuple[threading.Thread, list[Any]]:
    """An upload in a thread of its own, and what becomes of it."""
    results: list[Any] = []

    def run() -> None:
        try:
            results.append(store.put_file(BUCKET, KEY, file))
        except Exception as error:
            results.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread, results


def assert_not_there(server: S3Server) -> None:
    with pytest.raises(ObjectNotFoundError):
        store_at(server.endpoint, server).head(BUCKET, KEY)


def assert_whole(server: S3Server, file: Path, folder: Path) -> None:
    """The server has the file, as its bytes and its own checksum of the whole say; parts of other uploads go."""
    store = store_at(server.endpoint, server)
    assert store.find_same(BUCKET, KEY, file) is not None
    store.get_file(BUCKET, KEY, folder / "fetched")
    assert (folder / "fetched").read_bytes() == file.read_bytes()
    for left in store.unfinished_uploads(BUCKET, datetime.now(UTC) + timedelta(days=1)):
        store.abort_upload(left)
    assert store.unfinished_uploads(BUCKET, datetime.now(UTC) + timedelta(days=1)) == []


def test_a_server_that_is_killed_in_the_middle_of_an_upload_gets_it_when_it_is_back(
    mortal_s3: MortalS3Server, proxy: FaultProxy, large: Path, tmp_path: Path
) -> None:
    upload, results = uploading(store_at(proxy.endpoint, mortal_s3.server), large)
    wait_for(lambda: proxy.puts.total() >= 2, "two parts to be on their way")
    mortal_s3.kill()
    assert not results, "the upload was over before the server died"
    mortal_s3.come_back()
    upload.join(600)
    if results and isinstance(results[0], StorageUnavailableError):
        # It was away for longer than boto3's budget of retries lasts, as on a busy machine; jobs begin anew then.
        upload, results = uploading(store_at(proxy.endpoint, mortal_s3.server), large)
        upload.join(600)

    assert [getattr(result, "size_bytes", result) for result in results] == [SIZE]
    assert_whole(mortal_s3.server, large, tmp_path)


def test_a_storm_of_503_in_the_middle_of_an_upload_costs_time(
    mortal_s3: MortalS3Server, proxy: FaultProxy, large: Path, tmp_path: Path
) -> None:
    proxy.answer(503, "SlowDown", after_puts=2)
    upload, results = uploading(store_at(proxy.endpoint, mortal_s3.server), large)
    wait_for(lambda: proxy.refused >= 3, "some requests to be refused")
    assert_not_there(mortal_s3.server)
    proxy.pass_on()
    upload.join(600)

    assert [getattr(result, "size_bytes", result) for result in results] == [SIZE]
    assert_whole(mortal_s3.server, large, tmp_path)


def test_an_upload_that_is_given_up_leaves_neither_an_object_nor_parts(
    mortal_s3: MortalS3Server, proxy: FaultProxy, large: Path
) -> None:
    proxy.answer(503, "SlowDown", after_puts=2)
    upload, results = uploading(store_at(proxy.endpoint, mortal_s3.server, attempts=2), large)
    upload.join(600)
    assert [type(result).__name__ for result in results] == ["StorageUnavailableError"]
    proxy.pass_on()

    assert_not_there(mortal_s3.server)
    store = store_at(mortal_s3.server.endpoint, mortal_s3.server)
    left = store.unfinished_uploads(BUCKET, datetime.now(UTC) + timedelta(days=1))
    for each in left:  # the server refused to hear of the end, too: `robomaker fsck --mend` removes them a day later
        store.abort_upload(each)
    assert len(left) <= 1


def test_an_uploader_that_is_killed_leaves_parts_that_nobody_takes_for_an_object(
    mortal_s3: MortalS3Server, proxy: FaultProxy, large: Path, tmp_path: Path
) -> None:
    server = mortal_s3.server
    with subprocess.Popen(
        [sys.executable, "-c", UPLOAD, proxy.endpoint, str(large)], env={**os.environ, **server.environ()}
    ) as uploader:
        wait_for(lambda: proxy.puts.total() >= 2, "two parts to be on their way")
        uploader.send_signal(signal.SIGKILL)
    assert_not_there(server)
    store = store_at(server.endpoint, server)
    [left] = store.unfinished_uploads(BUCKET, datetime.now(UTC) + timedelta(days=1))
    assert left.key == KEY

    assert store.put_file(BUCKET, KEY, large).size_bytes == SIZE
    assert_whole(server, large, tmp_path)


@NEEDS_COMPILER
@pytest.mark.parametrize("hours", [-30, 30])
def test_a_clock_that_is_wrong_is_said(
    mortal_s3: MortalS3Server, proxy: FaultProxy, large: Path, tmp_path: Path, hours: int
) -> None:
    server = mortal_s3.server
    environ = {**os.environ, **server.environ(), **clock_environ(tmp_path / "clock", hours * 3600)}
    command = [sys.executable, "-c", UPLOAD, proxy.endpoint, str(large)]
    done = subprocess.run(command, env=environ, capture_output=True, text=True, check=False, timeout=600)

    told = done.stderr.splitlines()[-1]
    assert "StorageUnavailableError" in told, "it is waited for, and no role is to blame"
    assert "RequestTimeTooSkewed" in told
    assert_not_there(server)
