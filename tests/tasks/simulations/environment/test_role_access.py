"""What a job's code finds of the object store: unchanged programs with SDKs of all ages use it, on a real S3 server."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

import pytest
from helpers.package_installer import install_packages
from helpers.roles import role_with_keys, roles_file, user
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.environment.folders import AWS, Sandbox
from prefect_robomaker.tasks.simulations.environment.role_access import (
    container_variables,
    role_keys,
    store_variables,
    with_store_variables,
    write_store_files,
)

ARN = "arn:aws:iam::000000000000:role/nightly"
JOB_A = "arn:aws:iam::000000000000:role/JobA"
REQUEST = {"iamRole": ARN}
UPLOAD = "import boto3; boto3.client('s3').upload_file({path!r}, {bucket!r}, {key!r})"


def open_service(home: Path, environ: dict[str, str], *roles: str) -> Service:
    home.mkdir()
    variables = {**environ, "ROBOMAKER_HOME": str(home)}
    if roles:
        variables["ROBOMAKER_ROLES_FILE"] = str(roles_file(home, *roles))
    return Service.open(Settings.from_environment(variables), variables)


def environment_of(service: Service, request: dict[str, str], sandbox: Sandbox) -> dict[str, str]:
    """The variables of a program of a job, with the files that they name."""
    keys = role_keys(request, service)
    write_store_files(sandbox, service.settings, keys)
    usual = {"PATH": os.environ["PATH"], "HOME": str(sandbox.root), "AWS_DEFAULT_REGION": "us-east-1"}
    return with_store_variables(usual, store_variables(request, sandbox, service), has_keys=keys is not None)


@pytest.fixture
def sandbox(tmp_path: Path) -> Sandbox:
    return Sandbox(tmp_path / "root").create()


def test_credentials_of_an_assumed_role_are_read_again_by_programs(
    tmp_path: Path, role_server: S3Server, sandbox: Sandbox
) -> None:
    if "role-a" not in {each["Name"] for each in role_server.client("s3").list_buckets()["Buckets"]}:
        role_server.client("s3").create_bucket(Bucket="role-a")
    role = f'arn = "{JOB_A}"\nassume_role = "itself"\n'
    service = open_service(tmp_path / "home", role_server.environ(), role)
    environment = environment_of(service, {"iamRole": JOB_A}, sandbox)
    program = UPLOAD.format(path=__file__, bucket="role-a", key="a/file")

    subprocess.run([sys.executable, "-c", program], env=environment, check=True)

    keys = role_keys({"iamRole": JOB_A}, service)
    assert keys is not None
    assert not any(keys.secret_access_key in value for value in environment.values())
    write_store_files(sandbox, service.settings, replace(keys, secret_access_key="another"))
    refused = subprocess.run([sys.executable, "-c", program], env=environment, check=False, capture_output=True)
    assert b"SignatureDoesNotMatch" in refused.stderr, "the files say at each start what is true then"


@pytest.mark.deep
@pytest.mark.parametrize("packages", [("boto3==1.14.63", "urllib3<2"), ("boto3==1.27.1", "urllib3<2"), ("s3cmd",)])
def test_clients_of_all_ages_find_the_store(
    tmp_path: Path, s3_server: S3Server, sandbox: Sandbox, packages: tuple[str, ...]
) -> None:
    bucket = f"old-sdks-{uuid4().hex[:8]}"
    s3_server.client("s3").create_bucket(Bucket=bucket)
    keys = user(s3_server, writes=[f"{bucket}/*"])
    service = open_service(tmp_path / "home", s3_server.environ(), role_with_keys(ARN, keys))
    environment = environment_of(service, REQUEST, sandbox)
    programs = tmp_path / "client" / "bin"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", programs.parent], check=True)
    install_packages(*packages, python=programs / "python")
    command = [str(programs / "python"), "-c", UPLOAD.format(path=__file__, bucket=bucket, key="file")]
    if packages == ("s3cmd",):
        command = [str(programs / "s3cmd"), "put", __file__, f"s3://{bucket}/file"]

    subprocess.run(command, env=environment, check=True)

    stored = s3_server.client("s3").get_object(Bucket=bucket, Key="file")["Body"].read()
    assert stored == Path(__file__).read_bytes()


def test_without_roles_programs_are_led_to_the_server_without_keys(
    tmp_path: Path, s3_server: S3Server, sandbox: Sandbox
) -> None:
    service = open_service(tmp_path / "home", s3_server.environ())

    environment = environment_of(service, REQUEST, sandbox)

    assert environment["AWS_ENDPOINT_URL_S3"] == s3_server.endpoint
    files = [path.read_text() for path in sandbox.place(AWS).rglob("*") if path.is_file()]
    assert not any(s3_server.secret_key in text for text in files)


def test_with_objects_in_a_folder_nothing_leads_anywhere(tmp_path: Path, sandbox: Sandbox) -> None:
    service = open_service(tmp_path / "home", {}, f'arn = "{ARN}"\nread = ["maps/*"]\n')

    assert store_variables(REQUEST, sandbox, service) == {}


def test_placeholder_keys_go_where_the_role_has_some_and_models_stay() -> None:
    usual = {"AWS_ACCESS_KEY_ID": "local", "AWS_SECRET_ACCESS_KEY": "local", "AWS_DATA_PATH": "/models", "A": "1"}
    store = {"AWS_CONFIG_FILE": "/aws/config", "AWS_DATA_PATH": "/aws/models"}

    assert with_store_variables(usual, store, has_keys=True) == {
        "A": "1",
        "AWS_CONFIG_FILE": "/aws/config",
        "AWS_DATA_PATH": "/aws/models:/models",
    }
    assert with_store_variables(usual, store, has_keys=False)["AWS_ACCESS_KEY_ID"] == "local"


def test_containers_find_the_files_where_they_are_mounted() -> None:
    variables = {
        "AWS_CONFIG_FILE": "/here/config",
        "S3CMD_CONFIG": "/here/s3cfg",
        "AWS_DATA_PATH": "/here/models",
        "AWS_ENDPOINT_URL_S3": "http://127.0.0.1:9000",
        "TMPDIR": "/here/tmp",
    }

    assert container_variables(variables) == {
        "AWS_CONFIG_FILE": f"{AWS}/container.config",
        "S3CMD_CONFIG": f"{AWS}/s3cfg",
        "AWS_DATA_PATH": f"{AWS}/models",
        "AWS_ENDPOINT_URL_S3": "http://127.0.0.1:9000",
    }
