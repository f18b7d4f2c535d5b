"""A real MinIO server, where this machine has one: no package index does, `.ci/run` builds it from source.

It is not maintained any more: for tests on 127.0.0.1 only.
"""

import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from botocore.exceptions import BotoCoreError, ClientError

from helpers.required_programs import missing
from helpers.s3_server import S3Server

_READY_WITHIN_S = 200.0


@pytest.fixture(scope="session")
def minio_server() -> Iterator[S3Server]:
    """A server for this test process; skips where `minio` is not on the path."""
    program = shutil.which("minio")
    if program is None:
        missing("minio", "minio is not on the path; .ci/run says how to build it")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="minio-")))
        address, console = _addresses()
        server = S3Server(f"http://{address}")
        keys = {"MINIO_ROOT_USER": server.access_key, "MINIO_ROOT_PASSWORD": server.secret_key, "MINIO_UPDATE": "off"}
        log = stack.enter_context((folder / "log").open("wb"))
        process = subprocess.Popen(
            [program, "server", "--quiet", "--address", address, "--console-address", console, str(folder / "data")],
            env={**os.environ, **keys},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        _wait(server, process, folder / "log")
        yield server


def _addresses() -> tuple[str, str]:
    """Two free addresses, both held until both are known."""
    with socket.socket() as one, socket.socket() as other:
        for each in (one, other):
            each.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{one.getsockname()[1]}", f"127.0.0.1:{other.getsockname()[1]}"


def _wait(server: S3Server, process: "subprocess.Popen[bytes]", log: Path) -> None:
    give_up_at = time.monotonic() + _READY_WITHIN_S
    while process.poll() is None and time.monotonic() < give_up_at:
        with suppress(BotoCoreError, ClientError):
            server.client("s3").list_buckets()
            return
        time.sleep(0.1)
    raise RuntimeError(f"minio does not start; its log is:\n{log.read_text()[-4000:]}")
