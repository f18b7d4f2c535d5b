"""What our store writes is what another S3 client reads, and the other way round."""

import io
from datetime import UTC, datetime
from pathlib import Path
from uuid import uuid4

import pytest
from helpers.s3_server import S3Server
from minio import Minio

from prefect_robomaker.schemas.runs.provenance import Manifest
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.storage import publish
from prefect_robomaker.tasks.storage.s3 import S3Store


@pytest.fixture
def bucket(s3_server: S3Server) -> str:
    name = f"interop-{uuid4().hex[:12]}"
    store(s3_server).ensure_bucket(name)
    return name


def store(server: S3Server) -> S3Store:
    return S3Store(server.endpoint, "us-east-1", server.session())


def other(server: S3Server) -> Minio:
    address = server.endpoint.removeprefix("http://")
    return Minio(address, access_key=server.access_key, secret_key=server.secret_key, secure=False, region="us-east-1")


def test_published_files_are_found_by_another_client(s3_server: S3Server, bucket: str, tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "stdout.log").write_text("hello\n")
    (tmp_path / "größe.bin").write_bytes(bytes(range(256)))

    publish(
        store(s3_server),
        bucket,
        "job/run",
        regular_files(tmp_path),
        about={"job": "sim-1"},
        created_at=datetime.now(UTC),
    )

    client = other(s3_server)
    keys = {item.object_name for item in client.list_objects(bucket, prefix="job/run/", recursive=True)}
    assert keys == {"job/run/logs/stdout.log", "job/run/größe.bin", "job/run/manifest.json"}
    answer = client.get_object(bucket, "job/run/größe.bin")
    assert answer.data == bytes(range(256))
    answer.close()
    answer.release_conn()
    manifest = client.get_object(bucket, "job/run/manifest.json")
    assert len(Manifest.model_validate_json(manifest.data).files) == 2
    manifest.close()
    manifest.release_conn()


def test_objects_of_another_client_are_read(s3_server: S3Server, bucket: str) -> None:
    other(s3_server).put_object(bucket, "applications/mine.zip", io.BytesIO(b"content"), length=7)

    info = store(s3_server).head(bucket, "applications/mine.zip")

    assert info.size_bytes == 7
    assert store(s3_server).get_bytes(bucket, "applications/mine.zip") == b"content"
