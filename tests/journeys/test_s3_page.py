"""The lines of the guide that start an S3 server: a script uploads an archive to it, and the service finds that."""

import os
import re
import shlex
import signal
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import boto3
import pytest
from botocore.exceptions import BotoCoreError, ClientError
from helpers.paths import REPOSITORY
from helpers.processes import wait_for
from helpers.s3_server import free_ports

GUIDE = (REPOSITORY / "docs" / "coming-from-robomaker.md").read_text()


@pytest.mark.deep
def test_a_script_uploads_to_the_server_that_the_service_reads(
    robomaker: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ports = free_ports()
    [block] = re.findall(r"<!-- run s3 -->\n```console\n(.*?)```", GUIDE, re.DOTALL)
    _, start, export = (line.removeprefix("$ ") for line in block.splitlines())
    for name, value in (each.split("=", 1) for each in shlex.split(export)[1:]):
        monkeypatch.setenv(name, value.replace("8333", str(ports["s3.port"])))
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    folder = tmp_path / "s3"
    folder.mkdir()
    line = start.replace("~/s3", str(folder)) + "".join(f" -{name}={port}" for name, port in ports.items())
    environ = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "TMPDIR": str(folder)}
    with (tmp_path / "log").open("wb") as log:
        server = subprocess.Popen(
            ["sh", "-c", f"exec env {line}"], env=environ, stdout=log, stderr=log, start_new_session=True
        )
    try:
        s3 = boto3.client("s3")
        wait_for(lambda: has_bucket(s3), "the bucket", 200)
        with tarfile.open(tmp_path / "robot.tar.gz", "w:gz") as archive:
            archive.add(__file__, "robot.py")
        s3.upload_file(str(tmp_path / "robot.tar.gz"), "robomaker", "applications/robot.tar.gz")
        request = (
            "{name: robot, robotSoftwareSuite: {name: General}, "
            "sources: [{s3Bucket: robomaker, s3Key: applications/robot.tar.gz}]}"
        )
        answer = robomaker("call", "CreateRobotApplication", "--input", request)
        assert answer.code == 0, answer.err
        assert '"etag"' in answer.out
    finally:
        os.killpg(server.pid, signal.SIGKILL)
        server.wait()


def has_bucket(s3: Any) -> bool:
    try:
        return any(each["Name"] == "robomaker" for each in s3.list_buckets()["Buckets"])
    except (BotoCoreError, ClientError):
        return False
