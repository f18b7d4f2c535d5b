"""A real S3 server on this machine, started when the first test asks for it: SeaweedFS from the package index."""

import base64
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import boto3
import pytest
from botocore.config import Config
from botocore.exceptions import BotoCoreError, ClientError

from prefect_robomaker.tasks.storage.aws_sessions import new_session

_PORTS = (
    "s3.port", "s3.port.grpc", "master.port", "master.port.grpc", "volume.port", "volume.port.grpc",
    "filer.port", "filer.port.grpc", "admin.port", "admin.port.grpc",
)  # fmt: skip
_MORE = (
    "admin.ui=false",
    "volume.max=1000",
    "webdav=false",
    "s3.port.iceberg=0",
    "s3.port.lance=0",
    "master.telemetry=false",
)
_ROLES = "iam.json"
_BALLAST = "ballast"
_READY_WITHIN_S = 200.0
_STARTS = 3


@dataclass(frozen=True)
class S3Server:
    """A running server, and the keys of the user who may do everything."""

    endpoint: str
    access_key: str = "test-access-key"
    secret_key: str = "test-secret-key"

    def environ(self) -> dict[str, str]:
        """Environment variables that make this server the object store."""
        return {
            "ROBOMAKER_OBJECT_STORE": self.endpoint,
            "AWS_ACCESS_KEY_ID": self.access_key,
            "AWS_SECRET_ACCESS_KEY": self.secret_key,
        }

    def session(self) -> boto3.Session:
        """A session of the user who may do everything."""
        return new_session(self.access_key, self.secret_key)

    def client(self, service: str) -> Any:
        """A plain boto3 client for `s3` or `iam`, to look at things or to arrange them without our own code."""
        return _client(self, service)


@cache
def _client(server: S3Server, service: str) -> Any:
    """Makes it once: that takes longer than most of what tests ask of it."""
    session: Any = boto3.Session(aws_access_key_id=server.access_key, aws_secret_access_key=server.secret_key)
    return session.client(
        service,
        endpoint_url=server.endpoint,
        region_name="us-east-1",
        config=Config(s3={"addressing_style": "path"}, retries={"total_max_attempts": 2}, connect_timeout=2),
    )


@pytest.fixture(scope="session")
def role_server() -> Iterator[S3Server]:
    """Another one, whose STS lets its users assume the role `JobA`; it may use bucket `role-a` below `a/`."""
    with _own_folder() as (data, running):
        (data / _ROLES).write_text(json.dumps(_role_config()))
        yield _start(data, running)


def _role_config() -> dict[str, Any]:
    """SeaweedFS takes roles from a file only; its IAM makes users and policies."""
    objects = {"Effect": "Allow", "Action": ["s3:GetObject", "s3:PutObject", "s3:AbortMultipartUpload"]}
    lists = {"Effect": "Allow", "Action": ["s3:ListBucket"], "Resource": ["arn:aws:s3:::role-a"]}
    statements = [{**objects, "Resource": ["arn:aws:s3:::role-a/a/*"]}, lists]
    trust = {"Effect": "Allow", "Principal": "*", "Action": ["sts:AssumeRole"]}
    version = "2012-10-17"
    return {
        "sts": {
            "tokenDuration": "1h",
            "maxSessionLength": "12h",
            "issuer": "robomaker-tests",
            "signingKey": base64.b64encode(b"a key that signs tokens of tests").decode(),
        },
        "policy": {"defaultEffect": "Deny", "storeType": "memory"},
        "policies": [{"name": "JobA", "document": {"Version": version, "Statement": statements}}],
        "roles": [
            {
                "roleName": "JobA",
                "roleArn": "arn:aws:iam::role/JobA",
                "trustPolicy": {"Version": version, "Statement": [trust]},
                "attachedPolicies": ["JobA"],
            }
        ],
    }


@pytest.fixture(scope="session")
def s3_server() -> Iterator[S3Server]:
    """A server for this test process; every xdist worker has its own. Tests make buckets of their own."""
    with _own_folder() as (data, running):
        yield _start(data, running)


class MortalS3Server:
    """A server of one test's own, which the test kills, brings back with what it had stored, or makes hang.

    Args:
        data: An empty folder.
        running: Ends the server.
    """

    def __init__(self, data: Path, running: ExitStack) -> None:
        self._folder, self._ports, self.server, self._process = _first(data)
        running.callback(lambda: _stop(self._process, self._ports))

    def kill(self) -> None:
        """Ends it, as power that fails does; connections are refused from now on."""
        _stop(self._process, self._ports)

    def come_back(self) -> None:
        """Starts it again, on the same address and with the same objects."""
        self._process = _launch(self._folder, self._ports, self.server)
        if not _ready(self.server, self._process):
            raise RuntimeError(f"weed does not come back; its log is:\n{(self._folder / 'log').read_text()[-4000:]}")

    def hang(self) -> None:
        """Stops all work; connections are taken, and nothing is answered."""
        os.killpg(self._process.pid, signal.SIGSTOP)

    def go_on(self) -> None:
        """Ends the hanging."""
        os.killpg(self._process.pid, signal.SIGCONT)

    def fill_disk(self) -> None:
        """Takes all the space that its disk, which has to be a small one, has left."""
        with suppress(OSError), (self._folder / _BALLAST).open("wb", buffering=0) as ballast:
            while True:
                ballast.write(bytes(1 << 16))

    def make_space(self) -> None:
        """Gives the space back."""
        (self._folder / _BALLAST).unlink()


@pytest.fixture
def mortal_s3(request: pytest.FixtureRequest) -> Iterator[MortalS3Server]:
    """A server that a test may kill; `indirect` parameters give it a disk of its own of such a size, as `96m`."""
    with _own_folder() as (data, running):
        if size := getattr(request, "param", None):
            mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", data]
            if (mounted := subprocess.run(mount, capture_output=True, check=False)).returncode:
                pytest.skip(f"mounting a file system needs root: {mounted.stderr.decode().strip()}")
            running.callback(subprocess.run, ["umount", "--lazy", data], check=True)
        yield MortalS3Server(data, running)


@contextmanager
def _own_folder() -> Iterator[tuple[Path, ExitStack]]:
    """A folder for a server, and what ends the server before the folder goes."""
    data = Path(tempfile.mkdtemp(prefix="robomaker-s3-"))
    try:
        with ExitStack() as running:
            yield data, running
    finally:
        shutil.rmtree(data, ignore_errors=True)


def _start(data: Path, running: ExitStack) -> S3Server:
    _, ports, server, process = _first(data)
    running.callback(_stop, process, ports)
    return server


def _first(data: Path) -> tuple[Path, dict[str, int], S3Server, subprocess.Popen[bytes]]:
    folder = data
    for attempt in range(_STARTS):
        folder = data / str(attempt)
        ports = free_ports()
        server = S3Server(f"http://127.0.0.1:{ports['s3.port']}")
        process = _launch(folder, ports, server)
        if _ready(server, process):
            return folder, ports, server, process
        _stop(process, ports)  # most likely somebody took one of the ports
    raise RuntimeError(f"weed does not start; its log is:\n{(folder / 'log').read_text()[-4000:]}")


def _launch(folder: Path, ports: dict[str, int], server: S3Server) -> subprocess.Popen[bytes]:
    folder.mkdir(exist_ok=True)
    arguments = [f"{name}={port}" for name, port in ports.items()]
    arguments += [f"dir={folder}", "ip=127.0.0.1", "ip.bind=127.0.0.1", "s3.iam.readOnly=false", *_MORE]
    if (roles := folder.parent / _ROLES).is_file():
        arguments.append(f"s3.iam.config={roles}")
    keys = {"AWS_ACCESS_KEY_ID": server.access_key, "AWS_SECRET_ACCESS_KEY": server.secret_key}
    with (folder / "log").open("ab") as log:
        return subprocess.Popen(
            [Path(sys.executable).with_name("weed"), "-logtostderr=true", "mini", *(f"-{item}" for item in arguments)],
            env={**os.environ, **keys, "TMPDIR": str(folder)},
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )


def _ready(server: S3Server, process: subprocess.Popen[bytes]) -> bool:
    """Waits for an answer to a signed request: plain HTTP answers come before the server works."""
    deadline = time.monotonic() + _READY_WITHIN_S
    while process.poll() is None and time.monotonic() < deadline:
        with suppress(BotoCoreError, ClientError):
            server.client("s3").list_buckets()
            return True
        time.sleep(0.1)
    return False


def _stop(process: subprocess.Popen[bytes], ports: dict[str, int]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for left in Path(tempfile.gettempdir()).glob("seaweedfs-*.sock"):
        if any(str(port) in left.name for port in ports.values()):
            left.unlink(missing_ok=True)


def free_ports() -> dict[str, int]:
    """Free ports, all different: all are held until all are known."""
    with ExitStack() as held:
        sockets = [held.enter_context(socket.socket()) for _ in _PORTS]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return {name: one.getsockname()[1] for name, one in zip(_PORTS, sockets, strict=True)}
