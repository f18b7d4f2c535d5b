"""Uploading a job's outputs: `put_files` against boto3's own `upload_file` in a loop, on the same server."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.s3_server import S3Server

from prefect_robomaker.tasks.storage.s3 import S3Store

BUCKET = "benchmark"


def measured(action: Callable[[], object]) -> tuple[float, float]:
    """Wall-clock and CPU seconds of this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - wall, time.process_time() - cpu


@pytest.mark.benchmark
@pytest.mark.parametrize(("count", "size"), [(200, 10_000), (4, 20_000_000)], ids=["many-small", "few-large"])
def test_put_files_against_upload_file(
    s3_server: S3Server, tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int, size: int
):
    store = S3Store(s3_server.endpoint, "us-east-1", s3_server.session())
    store.ensure_bucket(BUCKET)
    files = {f"{index:04}": tmp_path / f"{index:04}" for index in range(count)}
    for path in files.values():
        path.write_bytes(os.urandom(size))
    plain = s3_server.client("s3")
    ours: list[tuple[float, float]] = []
    theirs: list[tuple[float, float]] = []
    for repeat in range(3):
        loop = [(str(path), BUCKET, f"plain{count}-{repeat}/{key}") for key, path in files.items()]
        theirs.append(measured(lambda loop=loop: [plain.upload_file(*one) for one in loop]))
        named = {f"ours{count}-{repeat}/{key}": path for key, path in files.items()}
        ours.append(measured(lambda named=named: store.put_files(BUCKET, named)))
    for side in ("plain", "ours"):
        assert [info.size_bytes for info in store.list(BUCKET, f"{side}{count}-2/")] == [size] * count
    (wall, cpu), (plain_wall, plain_cpu) = (tuple(map(min, zip(*side, strict=True))) for side in (ours, theirs))
    with capsys.disabled():
        print(
            f"\n{count} x {size / 1e6:g} MB: put_files {wall:.2f} s (CPU {cpu:.2f} s), upload_file in a loop "
            f"{plain_wall:.2f} s (CPU {plain_cpu:.2f} s): {plain_wall / wall:.1f} times faster, "
            f"CPU ratio {plain_cpu / cpu:.1f}; every object of put_files verified by CRC32 of the whole"
        )
