"""Credentials of an assumed role that run out while a job runs: had again from a real STS, and written anew."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import boto3
import pytest
from helpers.processes import wait_for
from helpers.roles import roles_file
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.environment.role_access import access_variables, fresh_keys
from prefect_robomaker.tasks.simulations.environment.run_environment import run_sandbox

REQUEST = {"iamRole": "arn:aws:iam::000000000000:role/JobA"}


def test_who_starts_late_has_credentials_that_are_good(
    tmp_path: Path, role_server: S3Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "role-a" not in {each["Name"] for each in role_server.client("s3").list_buckets()["Buckets"]}:
        role_server.client("s3").create_bucket(Bucket="role-a")
    role = f'arn = "{REQUEST["iamRole"]}"\nassume_role = "itself"\n'
    variables = {
        **role_server.environ(),
        "ROBOMAKER_HOME": str(tmp_path),
        "ROBOMAKER_ROLES_FILE": str(roles_file(tmp_path, role)),
    }
    service = Service.open(Settings.from_environment(variables), variables)
    sandbox = run_sandbox(tmp_path / "run").create()

    with fresh_keys(REQUEST, service, tmp_path / "run", every_s=0.05):
        folder = sandbox.place("/opt/robomaker/aws")
        files = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        assert service.roles is not None
        credentials = service.roles.opened.sessions[REQUEST["iamRole"]].get_credentials()
        # As the time does: they run out in a minute.
        vars(credentials)["_expiry_time"] = datetime.now(UTC) + timedelta(minutes=1)
        wait_for(lambda: any(path.read_bytes() != before for path, before in files.items()), "new credentials")

        usual = {"AWS_DEFAULT_REGION": "us-east-1"}
        environment = access_variables(usual, REQUEST, sandbox, service, {})
        monkeypatch.setattr("os.environ", environment)
        boto3.Session().client("s3").upload_file(__file__, "role-a", "a/file")
