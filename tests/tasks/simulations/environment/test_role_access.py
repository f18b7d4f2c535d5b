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
from prefect_robomaker.tasks.simulations.environment.aws_endpoints import brings_keys, without_refusal
from prefect_robomaker.tasks.simulations.environment.folders import AWS, Sandbox
from prefect_robomaker.tasks.simulations.environment.role_access import (
    access_variables,
    container_variables,
    role_keys,
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
    usual = {"PATH": os.environ["PATH"], "HOME": str(sandbox.root), "AWS_DEFAULT_REGION": "us-east-1"}
    return access_variables(usual, request, sandbox, service, {})


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
    assert environment["AWS_ENDPOINT_URL_STS"] == role_server.endpoint, "whose STS has assumed the role"
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

    assert access_variables({"A": "1"}, REQUEST, sandbox, service, {}) == {"A": "1"}


def test_placeholder_keys_go_where_the_role_has_some_and_models_stay(
    tmp_path: Path, s3_server: S3Server, sandbox: Sandbox
) -> None:
    usual = {"AWS_ACCESS_KEY_ID": "local", "AWS_SECRET_ACCESS_KEY": "local", "AWS_DATA_PATH": "/models", "A": "1"}
    keys = user(s3_server, writes=["any-bucket/*"])
    with_role = open_service(tmp_path / "home", s3_server.environ(), role_with_keys(ARN, keys))
    without = open_service(tmp_path / "another", s3_server.environ())

    found = access_variables(usual, REQUEST, sandbox, with_role, {})

    assert not found.keys() & {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"}
    assert found["AWS_DATA_PATH"] == f"{sandbox.place(AWS)}/no-aws:{sandbox.place(AWS)}/models:/models"
    assert access_variables(usual, REQUEST, sandbox, without, {})["AWS_ACCESS_KEY_ID"] == "local"


def test_a_program_with_keys_of_its_own_may_call_aws(sandbox: Sandbox, tmp_path: Path) -> None:
    service = open_service(tmp_path / "home", {})
    url = "http://127.0.0.1:8057/of-job/sim-1/key"
    usual = {"AWS_ACCESS_KEY_ID": "local", "AWS_ENDPOINT_URL_ROBOMAKER": url, "AWS_DATA_PATH": "/models"}

    found = access_variables(usual, REQUEST, sandbox, service, {"AWS_ENDPOINT_URL_ROBOMAKER": "http://127.0.0.1:8057"})
    let_through = without_refusal(found)

    assert found["AWS_ENDPOINT_URL"] == "http://127.0.0.1:8057/aws"
    assert "AWS_ENDPOINT_URL" not in let_through
    assert let_through["AWS_DATA_PATH"] == f"{sandbox.place(AWS)}/models:/models"
    assert let_through["AWS_ENDPOINT_URL_ROBOMAKER"] == url
    assert brings_keys({"AWS_PROFILE": "mine"})
    assert not brings_keys({"AWS_PROFILE": "default"})  # those are the job's anyway, and no AWS's
    assert brings_keys({"AWS_PROFILE": "default", "AWS_SHARED_CREDENTIALS_FILE": "/mine"})
    assert not brings_keys({"AWS_REGION": "eu-west-1", "AWS_ACCESS_KEY_ID": ""})
    allowing = replace(service, settings=service.settings.model_copy(update={"jobs_call_aws": True}))
    assert "AWS_ENDPOINT_URL" not in access_variables(usual, REQUEST, sandbox, allowing, {})


def test_containers_find_the_files_where_they_are_mounted() -> None:
    variables = {
        "AWS_CONFIG_FILE": "/here/config",
        "S3CMD_CONFIG": "/here/s3cfg",
        "AWS_DATA_PATH": f"/here{AWS}/no-aws:/here{AWS}/models:/of/the/job/worker",
        "AWS_ENDPOINT_URL_S3": "http://127.0.0.1:9000",
        "TMPDIR": "/here/tmp",
    }

    assert container_variables(variables) == {
        "AWS_CONFIG_FILE": f"{AWS}/container.config",
        "S3CMD_CONFIG": f"{AWS}/s3cfg",
        "AWS_DATA_PATH": f"{AWS}/no-aws:{AWS}/models",
        "AWS_ENDPOINT_URL_S3": "http://127.0.0.1:9000",
    }
