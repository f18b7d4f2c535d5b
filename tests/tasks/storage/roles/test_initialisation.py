"""`robomaker storage init` on a real S3 server: users, policies, buckets, keys in the roles file; again and again."""

import sys
from pathlib import Path
from unittest.mock import Mock
from uuid import uuid4

import pytest
from botocore.exceptions import ClientError
from helpers.roles import roles_file
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.roles import Role
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError, StorageAccessDeniedError, StorageError
from prefect_robomaker.tasks.storage import open_store
from prefect_robomaker.tasks.storage.roles import open_roles, read_roles_file
from prefect_robomaker.tasks.storage.roles.initialisation import IamUsers, MinioUsers, initialise, user_name, write_keys
from prefect_robomaker.tasks.storage.roles.roles_file import policy_of


@pytest.fixture(params=["s3_server", "minio_server"])
def server(request: pytest.FixtureRequest) -> S3Server:
    """A server with the interface of AWS IAM, and one with an interface of its own."""
    return request.getfixturevalue(request.param)


def buckets(server: S3Server) -> set[str]:
    return {each["Name"] for each in server.client("s3").list_buckets()["Buckets"]}


@pytest.mark.deep
def test_what_it_makes_works_and_making_it_again_changes_policies_only(tmp_path: Path, server: S3Server) -> None:
    word = uuid4().hex[:8]
    arn, bucket = f"arn:aws:iam::000000000000:role/{word}", f"init-{word}"
    path = roles_file(tmp_path, f'# the nightly one\narn = "{arn}"\nwrite = ["{bucket}/out/*"]\n')
    environ = {**server.environ(), "ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_ROLES_FILE": str(path)}
    settings = Settings.from_environment(environ)
    own = open_store(settings, environ)
    written = path.read_text()

    planned = list(initialise(settings, own, environ, dry_run=True))
    assert path.read_text() == written
    assert bucket not in buckets(server)
    made = list(initialise(settings, own, environ))

    assert made == planned
    assert user_name(arn) in made[1]
    assert len(made) == 3
    [role] = read_roles_file(path)
    assert "# the nightly one" in path.read_text()
    roles = open_roles(settings, own, environ)
    assert roles is not None
    store = roles.store_of(arn)
    store.put_bytes(bucket, "out/x", b"x")
    assert [info.key for info in store.list(bucket, "out/")] == ["out/x"]
    with pytest.raises(StorageAccessDeniedError):
        store.put_bytes(bucket, "elsewhere", b"x")

    path.write_text(path.read_text().replace("out/*", "elsewhere*"))
    again = list(initialise(settings, own, environ))
    assert again == made[:2]
    assert read_roles_file(path)[0].access_key_id == role.access_key_id
    store.put_bytes(bucket, "elsewhere", b"x")
    with pytest.raises(StorageAccessDeniedError):
        store.put_bytes(bucket, "out/x", b"x")


def test_keys_of_ones_own_are_left_alone(tmp_path: Path, server: S3Server) -> None:
    role = 'arn = "arn:aws:iam::1:role/own"\nread = ["own-keys/*"]\naccess_key_id = "A"\nsecret_access_key = "S"\n'
    path = roles_file(tmp_path, role)
    environ = {**server.environ(), "ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_ROLES_FILE": str(path)}
    settings = Settings.from_environment(environ)

    steps = list(initialise(settings, open_store(settings, environ), environ))

    assert steps == ["bucket own-keys"]


def test_in_a_folder_it_makes_buckets(tmp_path: Path) -> None:
    path = roles_file(tmp_path, 'arn = "arn:aws:iam::1:role/a"\nread = ["maps/*"]\n')
    environ = {"ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_ROLES_FILE": str(path)}
    settings = Settings.from_environment(environ)

    steps = list(initialise(settings, open_store(settings, environ), environ))

    assert list(steps) == ["bucket maps"]
    assert (tmp_path / "objects" / "maps").is_dir()


def test_a_file_that_nothing_can_be_added_to_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "roles.toml"
    path.write_text('role = [{arn = "arn:aws:iam::1:role/a"}]\n')
    path.chmod(0o600)

    with pytest.raises(ConfigurationError, match=r"roles below a line \[\[role\]\]"):
        write_keys(path, 0, "A", "S")
    assert "S" not in path.read_text().replace("aws", "")


def test_without_a_roles_file_it_says_what_to_set(tmp_path: Path) -> None:
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path)})

    with pytest.raises(ConfigurationError, match="ROBOMAKER_ROLES_FILE is not set"):
        list(initialise(settings, open_store(settings, {}), {}))


def test_keys_that_may_not_make_users_are_refused_by_minio(tmp_path: Path, minio_server: S3Server) -> None:
    admin, name = MinioUsers(minio_server.endpoint, minio_server.environ()), f"mere-{uuid4().hex[:8]}"
    admin.ensure(name, policy_of(Role(arn="arn:aws:iam::1:role/a", read=("maps/*",))))
    name, key = admin.new_key(name)
    users = MinioUsers(minio_server.endpoint, {"AWS_ACCESS_KEY_ID": name, "AWS_SECRET_ACCESS_KEY": key})

    with pytest.raises(StorageAccessDeniedError, match="cannot make a policy at"):
        users.ensure("other", '{"Version": "2012-10-17", "Statement": []}')


def test_a_server_that_makes_no_users_is_told_with_what_to_change() -> None:
    said = "IAM write operations are disabled on this server"  # SeaweedFS 4.48
    refusal = ClientError({"Error": {"Code": "AccessDenied", "Message": said}}, "CreateUser")
    users = IamUsers("http://127.0.0.1:9", "us-west-2", {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"})

    with pytest.raises(StorageError, match=r"start SeaweedFS with -s3\.iam\.readOnly=false"):
        users.ask("make a user", Mock(side_effect=refusal))


def test_minio_needs_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "minio", None)

    with pytest.raises(ConfigurationError, match="uv sync --frozen --inexact --extra minio"):
        MinioUsers("http://127.0.0.1:9", {})
