"""The object store as roles have it: on a real S3 server with users, policies and STS, and in a folder."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from helpers.roles import role_with_keys, roles_file, user
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.roles import Role
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import (
    CredentialsRefusedError,
    StorageAccessDeniedError,
    StorageUnavailableError,
)
from prefect_robomaker.tasks.storage import open_store
from prefect_robomaker.tasks.storage.roles import Roles, open_roles
from prefect_robomaker.tasks.storage.roles.initialisation import MinioUsers
from prefect_robomaker.tasks.storage.roles.roles_file import policy_of

ARN = "arn:aws:iam::000000000000:role/nightly"
JOB_A = "arn:aws:iam::000000000000:role/JobA"


def opened(home: Path, environ: Mapping[str, str], *roles: str) -> Roles:
    variables = {**environ, "ROBOMAKER_HOME": str(home), "ROBOMAKER_ROLES_FILE": str(roles_file(home, *roles))}
    settings = Settings.from_environment(variables)
    found = open_roles(settings, open_store(settings, environ), environ)
    assert found is not None
    return found


def own_bucket(server: S3Server) -> None:
    """Makes the bucket of the server's role, once for all tests."""
    if "role-a" not in {each["Name"] for each in server.client("s3").list_buckets()["Buckets"]}:
        server.client("s3").create_bucket(Bucket="role-a")


@pytest.fixture
def bucket(s3_server: S3Server) -> str:
    name = f"roles-{uuid4().hex[:12]}"
    s3_server.client("s3").create_bucket(Bucket=name)
    return name


def test_a_role_has_the_rights_of_its_user_and_no_others(tmp_path: Path, s3_server: S3Server, bucket: str) -> None:
    keys = user(s3_server, reads=[f"{bucket}/in/*"], writes=[f"{bucket}/out/*"])
    s3_server.client("s3").put_object(Bucket=bucket, Key="in/map", Body=b"map")
    store = opened(tmp_path, s3_server.environ(), role_with_keys(ARN, keys)).store_of(ARN)

    store.put_bytes(bucket, "out/log", b"log")
    store.check_writable(bucket, "out/manifest.json")

    assert store.get_bytes(bucket, "in/map") == b"map"
    assert not s3_server.client("s3").list_multipart_uploads(Bucket=bucket).get("Uploads")
    for forbidden in (
        lambda: store.put_bytes(bucket, "in/map", b"other"),
        lambda: store.check_writable(bucket, "in/map"),
        lambda: store.get_bytes(bucket, "elsewhere"),
        lambda: list(store.list(bucket, "in/")),
    ):
        with pytest.raises(StorageAccessDeniedError):
            forbidden()


@pytest.mark.parametrize("secret", ["wrong", None])
def test_keys_that_the_server_does_not_know_are_refused_as_such(
    tmp_path: Path, s3_server: S3Server, secret: str | None
) -> None:
    key, real = user(s3_server, writes=["some-bucket/*"])
    keys = (key, secret) if secret else ("NOBODY", real)
    with pytest.raises(CredentialsRefusedError):
        opened(tmp_path, s3_server.environ(), role_with_keys(ARN, keys)).store_of(ARN)


def test_a_role_that_the_file_does_not_name_is_refused(tmp_path: Path, s3_server: S3Server) -> None:
    roles = opened(tmp_path, s3_server.environ(), f'arn = "{ARN}"\n')

    with pytest.raises(CredentialsRefusedError, match="role/other is not in the roles file"):
        roles.store_of(f"{ARN[:-7]}other")
    with pytest.raises(CredentialsRefusedError, match="no credentials in the roles file"):
        roles.store_of(ARN)


def test_a_role_is_assumed_where_the_server_has_sts(tmp_path: Path, role_server: S3Server) -> None:
    own_bucket(role_server)
    roles = opened(tmp_path, role_server.environ(), f'arn = "{JOB_A}"\nassume_role = "itself"\n')

    store = roles.store_of(JOB_A)
    store.put_bytes("role-a", "a/x", b"x")

    with pytest.raises(StorageAccessDeniedError):
        store.put_bytes("role-a", "b/x", b"x")
    keys = roles.keys_of(JOB_A)
    assert keys is not None
    assert keys.session_token
    assert keys.expires_at is not None
    assert timedelta(minutes=50) < keys.expires_at - datetime.now(UTC) < timedelta(minutes=70)


def test_the_places_of_a_role_narrow_what_is_assumed(tmp_path: Path, role_server: S3Server) -> None:
    own_bucket(role_server)
    role = f'arn = "{ARN}"\nassume_role = "{JOB_A}"\nwrite = ["role-a/a/narrow/*"]\n'
    store = opened(tmp_path, role_server.environ(), role).store_of(ARN)

    store.put_bytes("role-a", "a/narrow/x", b"x")

    with pytest.raises(StorageAccessDeniedError):
        store.put_bytes("role-a", "a/x", b"x")


def test_minio_lends_the_rights_of_a_user_and_places_narrow_them(tmp_path: Path, minio_server: S3Server) -> None:
    bucket, name = f"roles-{uuid4().hex[:12]}", f"user-{uuid4().hex[:8]}"
    minio_server.client("s3").create_bucket(Bucket=bucket)
    users = MinioUsers(minio_server.endpoint, minio_server.environ())
    users.ensure(name, policy_of(Role(arn=ARN, write=(f"{bucket}/a/*",))))
    role = role_with_keys(ARN, users.new_key(name)) + 'assume_role = "itself"\n'
    role += f'write = ["{bucket}/a/narrow/*", "{bucket}/b/*"]\n'
    roles = opened(tmp_path, minio_server.environ(), role)

    store = roles.store_of(ARN)
    store.put_bytes(bucket, "a/narrow/x", b"x")

    for key in ("a/x", "b/x"):
        with pytest.raises(StorageAccessDeniedError):
            store.put_bytes(bucket, key, b"x")
    keys = roles.keys_of(ARN)
    assert keys is not None
    assert keys.session_token


def test_a_role_that_the_server_does_not_know_cannot_be_assumed(tmp_path: Path, role_server: S3Server) -> None:
    unknown = "arn:aws:iam::000000000000:role/Unknown"
    roles = opened(tmp_path, role_server.environ(), f'arn = "{unknown}"\nassume_role = "itself"\n')

    with pytest.raises(CredentialsRefusedError, match="role/Unknown cannot be assumed"):
        roles.store_of(unknown)


def test_a_server_that_does_not_answer_refuses_nobody(tmp_path: Path) -> None:
    environ = {"ROBOMAKER_OBJECT_STORE": "http://127.0.0.1:9", "AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"}
    roles = opened(tmp_path, environ, f'arn = "{ARN}"\nassume_role = "itself"\n')

    with pytest.raises(StorageUnavailableError):
        roles.store_of(ARN)


@pytest.mark.parametrize(
    ("slug", "members"),
    [
        ("aws-credentials", ("aws_access_key_id", "aws_secret_access_key")),
        ("minio-credentials", ("minio_root_user", "minio_root_password")),
    ],
)
def test_a_role_may_be_a_block(
    tmp_path: Path, s3_server: S3Server, bucket: str, slug: str, members: tuple[str, str]
) -> None:
    content: dict[str, Any] = dict(zip(members, user(s3_server, writes=[f"{bucket}/*"]), strict=True))
    roles = opened(tmp_path, s3_server.environ(), f'arn = "{ARN}"\nblock = "{slug}/robots"\n')

    with pytest.raises(CredentialsRefusedError, match="does not use Prefect"):
        roles.store_of(ARN)
    with pytest.raises(CredentialsRefusedError, match=f"no block {slug}/robots"):
        roles.with_blocks(lambda slug, name: None).store_of(ARN)
    store = roles.with_blocks(lambda found, name: content if (found, name) == (slug, "robots") else None).store_of(ARN)
    store.put_bytes(bucket, "x", b"x")


def test_a_role_may_be_a_profile(
    tmp_path: Path, s3_server: S3Server, bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    key, secret = user(s3_server, writes=[f"{bucket}/*"])
    file = tmp_path / "credentials"
    file.write_text(f"[robots]\naws_access_key_id = {key}\naws_secret_access_key = {secret}\n")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(file))

    opened(tmp_path, s3_server.environ(), f'arn = "{ARN}"\nprofile = "robots"\n').store_of(ARN).put_bytes(
        bucket, "x", b""
    )
    with pytest.raises(CredentialsRefusedError, match="other"):
        opened(tmp_path, s3_server.environ(), f'arn = "{ARN}"\nprofile = "other"\n').store_of(ARN)


def test_in_a_folder_a_role_has_its_places_and_no_keys(tmp_path: Path) -> None:
    role = f'arn = "{ARN}"\nread = ["maps/flat/*"]\nwrite = ["results/a/*"]\n'
    roles = opened(tmp_path, {}, role)
    roles.own_store.ensure_bucket("maps")
    roles.own_store.put_bytes("maps", "flat/1", b"1")
    roles.own_store.put_bytes("maps", "secret", b"s")
    store = roles.store_of(ARN)

    store.ensure_bucket("results")
    store.check_writable("results", "a/x")
    store.put_bytes("results", "a/x", b"x")

    assert roles.keys_of(ARN) is None
    assert store.get_bytes("results", "a/x") == b"x"
    assert [info.key for info in store.list("maps", "flat/")] == ["flat/1"]
    assert store.local_path("maps", "secret") is None
    for forbidden in (
        lambda: store.get_bytes("maps", "secret"),
        lambda: store.head("maps", "secret"),
        lambda: store.list("maps"),
        lambda: store.put_bytes("maps", "flat/1", b"2"),
        lambda: store.put_files("results", {"a/ok": tmp_path / "roles.toml", "b/no": tmp_path / "roles.toml"}),
        lambda: store.delete("maps", "flat/1"),
        lambda: store.ensure_bucket("maps"),
        lambda: store.check_writable("results", "b/x"),
    ):
        with pytest.raises(StorageAccessDeniedError, match="nightly may not"):
            forbidden()
    assert not list(roles.own_store.list("results", "a/ok"))
