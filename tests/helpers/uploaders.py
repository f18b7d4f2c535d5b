"""Uploads of a folder's files to an S3 server by this project and by others, each in a process of its own.

Run as a program, it is one that is written in Python: `uploaders.py NAME ENDPOINT BUCKET PREFIX FOLDER` prints how long
the upload took, once all is imported and connected.
"""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

REGION = "us-east-1"
PLAIN_THREADS = 8
_LOOK_S = 0.02
_RCLONE = ["--s3-provider=Other", "--s3-env-auth", "--s3-force-path-style", "--s3-no-check-bucket", "--ignore-times"]


@dataclass(frozen=True)
class Target:
    """Where what is uploaded."""

    endpoint: str
    bucket: str
    prefix: str
    folder: Path

    def keys(self) -> dict[str, Path]:
        """The folder's files by the keys that they get."""
        files = sorted(path for path in self.folder.rglob("*") if path.is_file())
        return {f"{self.prefix}/{path.relative_to(self.folder).as_posix()}": path for path in files}


@dataclass(frozen=True)
class Took:
    """What an upload took."""

    wall_s: float
    cpu_s: float
    """Of the whole process, imports included."""

    memory_mb: float
    """The most that was resident."""


def ours(target: Target) -> Callable[[], object]:
    """This project's `put_files`."""
    from prefect_robomaker.tasks.storage.s3 import S3Store

    store = S3Store(target.endpoint, REGION)
    return lambda: store.put_files(target.bucket, target.keys())


def published(target: Target) -> Callable[[], object]:
    """What this project does with a job's outputs: their SHA-256, `put_files`, and the manifest."""
    from datetime import UTC, datetime

    from prefect_robomaker.tasks.files.untrusted_folders import regular_files
    from prefect_robomaker.tasks.storage import publish
    from prefect_robomaker.tasks.storage.s3 import S3Store

    store, files = S3Store(target.endpoint, REGION), list(regular_files(target.folder))
    now = datetime.now(UTC)
    return lambda: publish(store, target.bucket, target.prefix, files, about={}, created_at=now)


def plain_threads(target: Target) -> Callable[[], object]:
    """boto3's own `upload_file` in threads."""
    client = _client(target)

    def upload() -> None:
        with ThreadPoolExecutor(PLAIN_THREADS) as pool:
            for done in [
                pool.submit(client.upload_file, str(path), target.bucket, key) for key, path in target.keys().items()
            ]:
                done.result()

    return upload


def awscrt(target: Target) -> Callable[[], object]:
    """The transfer client in C that `boto3[crt]` installs; boto3 itself would write to AWS whatever the endpoint."""
    import botocore.session
    from awscrt.auth import AwsCredentialsProvider  # pyright: ignore[reportMissingImports] - need not be there
    from botocore.config import Config
    from s3transfer import crt

    session = botocore.session.get_session()
    about = {"region_name": REGION, "endpoint_url": target.endpoint}
    style = Config(s3={"addressing_style": "path"})
    serializer = crt.BotocoreCRTRequestSerializer(session, {**about, "config": style})
    keys = AwsCredentialsProvider.new_static(os.environ["AWS_ACCESS_KEY_ID"], os.environ["AWS_SECRET_ACCESS_KEY"])
    client = crt.create_s3_crt_client(REGION, crt_credentials_provider=keys, use_ssl=False)

    def upload() -> None:
        with crt.CRTTransferManager(client, serializer) as manager:
            for done in [manager.upload(str(path), target.bucket, key) for key, path in target.keys().items()]:
                done.result()

    return upload


def _s5cmd(target: Target) -> list[str]:
    where = f"s3://{target.bucket}/{target.prefix}/"
    return ["s5cmd", "--endpoint-url", target.endpoint, "--log=error", "cp", f"{target.folder}/", where]


def _rclone(target: Target) -> list[str]:
    return [
        *("rclone", "copy", "--config=/dev/null", *_RCLONE, "--transfers=16", f"--s3-endpoint={target.endpoint}"),
        *(str(target.folder), f":s3:{target.bucket}/{target.prefix}"),
    ]


def _aws(target: Target) -> list[str]:
    where = f"s3://{target.bucket}/{target.prefix}/"
    return ["aws", "--endpoint-url", target.endpoint, "s3", "cp", "--recursive", "--quiet", str(target.folder), where]


_IN_PYTHON = {each.__name__: each for each in (ours, published, plain_threads, awscrt)}
_COMMANDS = {"s5cmd": _s5cmd, "rclone": _rclone, "aws": _aws}


def found() -> list[str]:
    """The names of those that are installed here."""
    return [
        *(name for name in _IN_PYTHON if name != "awscrt" or find_spec("awscrt")),
        *(name for name in _COMMANDS if shutil.which(name)),
    ]


def upload(name: str, target: Target, environ: Mapping[str, str]) -> Took:
    """Uploads with one of them; the start of those that are commands counts."""
    where = [target.endpoint, target.bucket, target.prefix, str(target.folder)]
    command = [sys.executable, __file__, name, *where] if name in _IN_PYTHON else _COMMANDS[name](target)
    environ = {**os.environ, **environ, "AWS_REGION": REGION, "AWS_EC2_METADATA_DISABLED": "true"}
    began = time.perf_counter()
    with TemporaryFile("w+") as said:
        process = subprocess.Popen(command, env=environ, stdout=said, stderr=said)
        memory_mb = 0.0
        while not (ended := os.wait4(process.pid, os.WNOHANG))[0]:
            memory_mb = max(memory_mb, _most_resident_mb(process.pid))
            time.sleep(_LOOK_S)
        wall_s, used = time.perf_counter() - began, ended[2]
        said.seek(0)
        output = said.read()
    process.returncode = os.waitstatus_to_exitcode(ended[1])
    if process.returncode:
        raise RuntimeError(f"{name} failed: {output[-2000:]}")
    if name in _IN_PYTHON:
        wall_s = float(output.split()[-1])
    return Took(wall_s, used.ru_utime + used.ru_stime, memory_mb)


def _most_resident_mb(pid: int) -> float:
    """What `ru_maxrss` is not: that of a process that was started by a larger one is the larger one's."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return 0.0


def _client(target: Target) -> Any:
    import boto3
    from botocore.config import Config

    style = Config(s3={"addressing_style": "path"}, max_pool_connections=32)
    return boto3.Session().client("s3", endpoint_url=target.endpoint, region_name=REGION, config=style)


def main(name: str, endpoint: str, bucket: str, prefix: str, folder: str) -> None:
    """Uploads, and prints the seconds that it took."""
    target = Target(endpoint, bucket, prefix, Path(folder))
    do = _IN_PYTHON[name](target)
    _client(target).head_bucket(Bucket=bucket)  # what boto3 loads when it is first used
    began = time.perf_counter()
    do()
    print(time.perf_counter() - began)


if __name__ == "__main__":
    main(*sys.argv[1:])
