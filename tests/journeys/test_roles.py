"""Jobs act with the rights of their role, and so does unchanged S3 code in them: on a real S3 server, in a folder."""

import json
import shutil
import site
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from helpers.real_engine import RealEngine
from helpers.roles import role_with_keys, roles_file, user
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz, read_manifest

ARN = "arn:aws:iam::000000000000:role"
UPLOADS = """
import boto3, json, os, pathlib
s3 = boto3.client("s3")
pathlib.Path("note").write_text("from inside")
s3.upload_file("note", "BUCKET", "out/note")
try:
    s3.upload_file("note", "BUCKET", "forbidden/note")
except Exception as error:
    print("refused:", error)
keys = [name for name in os.environ if "SECRET" in name or "TOKEN" in name]
assert not keys, keys
"""

FACTORY = """
import dm_env, numpy, pathlib

class Still(dm_env.Environment):
    def reset(self):
        return dm_env.restart({})

    def step(self, action):
        return dm_env.termination(0.0, {})

    def action_spec(self):
        return dm_env.specs.BoundedArray((1,), float, -1.0, 1.0)

    def observation_spec(self):
        return {}

def make_environment(context):
    exec(pathlib.Path(__file__).with_name("main.py").read_text())
    return Still()

def make_agent(context, environment):
    return lambda time_step: numpy.zeros(1)
"""

IN_A_CONTAINER = """
import boto3, os
s3, bucket, folder = boto3.client("s3"), os.environ["BUCKET"], os.environ["FOLDER"]
s3.put_object(Bucket=bucket, Key=folder + "/note", Body=b"from inside")
assert s3.get_object(Bucket=bucket, Key=folder + "/note")["Body"].read() == b"from inside"
try:
    s3.put_object(Bucket=bucket, Key="forbidden/note", Body=b"")
except Exception as error:
    print("refused:", error)
assert not [name for name in os.environ if "SECRET" in name or "TOKEN" in name]
"""
SDK = ("boto3", "botocore", "s3transfer", "jmespath", "dateutil", "urllib3", "six.py")

Run = Callable[..., dict[str, Any]]


def open_service(home: Path, environ: Mapping[str, str], *roles: str) -> Service:
    variables = {**environ, "ROBOMAKER_HOME": str(home), "ROBOMAKER_BUCKET": f"own-{uuid4().hex[:8]}"}
    home.mkdir(exist_ok=True)
    if roles:
        variables["ROBOMAKER_ROLES_FILE"] = str(roles_file(home, *roles))
    return Service.open(Settings.from_environment(variables), variables)


def run(service: Service, folder: Path, bucket: str, program: str = "", **members: Any) -> dict[str, Any]:
    """Runs a job whose simulation is a program; its archive is in the bucket below `in/`."""
    code = folder / "code"
    (code / "uploads").mkdir(parents=True, exist_ok=True)
    (code / "uploads" / "main.py").write_text(program.replace("BUCKET", bucket))
    (code / "uploads" / "arena.py").write_text(FACTORY)
    pack_tar_gz(code, folder / "code.tar.gz")
    service.store.ensure_bucket(bucket)
    service.store.put_file(bucket, "in/code.tar.gz", folder / "code.tar.gz")
    application = {
        "name": "uploads",
        "sources": [{"s3Bucket": bucket, "s3Key": "in/code.tar.gz"}],
        "robotSoftwareSuite": {"name": "General"},
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
    }
    if not call("ListSimulationApplications", {}, service)["simulationApplicationSummaries"]:
        call("CreateSimulationApplication", application, service)
    launch = {"packageName": "uploads", "launchFile": "main.py", **members.pop("launch", {})}
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": f"{ARN}/nightly",
        "outputLocation": {"s3Bucket": bucket, "s3Prefix": "out"},
        "simulationApplications": [{"application": "uploads", "launchConfig": launch}],
        **members,
    }
    job = call("CreateSimulationJob", request, service)
    return registry()["CreateSimulationJob"].perform(job["arn"], service)


def log_of(service: Service, job: dict[str, Any], name: str = "simulation.stdout.log") -> str:
    place = service.catalog.get(job["arn"]).document["outputs"]
    return service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/{name}").decode()


@pytest.fixture
def bucket(s3_server: S3Server) -> str:
    name = f"roles-{uuid4().hex[:12]}"
    s3_server.client("s3").create_bucket(Bucket=name)
    return name


@pytest.mark.parametrize("network", ["full", pytest.param("local", marks=pytest.mark.deep)])
def test_unchanged_s3_code_in_a_job_acts_as_its_role(
    tmp_path: Path,
    s3_server: S3Server,
    bucket: str,
    prefect_server: str,
    network: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", network)
    monkeypatch.setenv("ROBOMAKER_OBJECT_STORE", s3_server.endpoint)
    keys = user(s3_server, reads=[f"{bucket}/in/*"], writes=[f"{bucket}/out/*"])
    service = open_service(tmp_path / "home", s3_server.environ(), role_with_keys(f"{ARN}/nightly", keys))

    job = run(service, tmp_path, bucket, UPLOADS)

    assert job["status"] == "Completed", job["failureReason"]
    assert s3_server.client("s3").get_object(Bucket=bucket, Key="out/note")["Body"].read() == b"from inside"
    assert "refused" in log_of(service, job)
    assert "AccessDenied" in log_of(service, job)
    place = service.catalog.get(job["arn"]).document["outputs"]
    stored = [file.path for file in read_manifest(service.store, **place).files]
    for name in stored:
        content = service.store.get_bytes(place["bucket"], f"{place['prefix']}/{name}")
        assert keys[1].encode() not in content, f"{name} has the role's key"


ROUND = """
import boto3
s3 = boto3.client("s3")
s3.put_object(Bucket="BUCKET", Key="out/note", Body=b"from inside")
assert s3.get_object(Bucket="BUCKET", Key="out/note")["Body"].read() == b"from inside"
"""


@pytest.mark.deep
@pytest.mark.parametrize("by", ["variables", "file", "nothing"])
def test_without_a_roles_file_code_brings_its_own_credentials(
    tmp_path: Path, s3_server: S3Server, bucket: str, prefect_server: str, by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The two ways that docs/roles.md has; without one of them S3 is refused."""
    identity, secret = user(s3_server, reads=[f"{bucket}/in/*"], writes=[f"{bucket}/out/*"])
    shown = tmp_path / "shown"
    shown.mkdir()
    (shown / "credentials").write_text(f"[default]\naws_access_key_id = {identity}\naws_secret_access_key = {secret}\n")
    variables = {
        "variables": {"AWS_ACCESS_KEY_ID": identity, "AWS_SECRET_ACCESS_KEY": secret},
        "file": {"AWS_SHARED_CREDENTIALS_FILE": str(shown / "credentials")},
        "nothing": {"NOTHING": "1"},
    }[by]
    environ = {**s3_server.environ(), "ROBOMAKER_SANDBOX_SHOW": str(shown)}
    monkeypatch.setenv("ROBOMAKER_SANDBOX_SHOW", str(shown))
    service = open_service(tmp_path / "home", environ)

    job = run(service, tmp_path, bucket, ROUND, launch={"environmentVariables": variables})

    if by == "nothing":
        assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
        return
    assert job["status"] == "Completed", job["failureReason"]
    place = service.catalog.get(job["arn"]).document["outputs"]
    for file in read_manifest(service.store, **place).files:
        content = service.store.get_bytes(place["bucket"], f"{place['prefix']}/{file.path}")
        assert secret.encode() not in content, f"{file.path} has the key"


@pytest.mark.deep
def test_unchanged_s3_code_in_a_factory_acts_as_its_role(
    tmp_path: Path, s3_server: S3Server, bucket: str, prefect_server: str
) -> None:
    keys = user(s3_server, reads=[f"{bucket}/in/*"], writes=[f"{bucket}/out/*"])
    service = open_service(tmp_path / "home", s3_server.environ(), role_with_keys(f"{ARN}/nightly", keys))
    source = {"sources": [{"s3Bucket": bucket, "s3Key": "in/code.tar.gz"}]}
    agent = {"packageName": "uploads", "launchFile": "arena.make_agent"}
    run(service, tmp_path, bucket, UPLOADS)  # its archive is there now
    service.store.delete(bucket, "out/note")
    call("CreateRobotApplication", {"name": "idle", **source, "robotSoftwareSuite": {"name": "General"}}, service)

    job = run(
        service,
        tmp_path,
        bucket,
        UPLOADS,
        launch={"launchFile": "arena.make_environment"},
        robotApplications=[{"application": "idle", "launchConfig": agent}],
    )

    assert job["status"] == "Completed", job["failureReason"]
    assert service.store.get_bytes(bucket, "out/note") == b"from inside"
    assert "refused:" in log_of(service, job, "stdout.log")


def test_what_a_role_may_not_do_ends_a_job_with_the_services_code(
    tmp_path: Path, s3_server: S3Server, bucket: str, prefect_server: str
) -> None:
    readable = [f"{bucket}/in/*"]
    service = open_service(
        tmp_path / "home",
        s3_server.environ(),
        role_with_keys(f"{ARN}/reader", user(s3_server, reads=readable)),
        role_with_keys(f"{ARN}/writer", user(s3_server, writes=[f"{bucket}/out/*"])),
        role_with_keys(f"{ARN}/nightly", user(s3_server, reads=readable, writes=[f"{bucket}/out/*"])),
        role_with_keys(f"{ARN}/stranger", ("NOBODY", "nothing")),
    )
    s3_server.client("s3").put_object(Bucket=bucket, Key="secret/map", Body=b"map")
    data = [{"name": "maps", "s3Bucket": bucket, "s3Keys": ["secret/map"]}]

    ended = {
        name: run(service, tmp_path, bucket, **members)
        for name, members in {
            "no output": {"iamRole": f"{ARN}/reader"},
            "no application": {"iamRole": f"{ARN}/writer"},
            "no data": {"dataSources": data},
            "no such keys": {"iamRole": f"{ARN}/stranger"},
            "no such role": {"iamRole": f"{ARN}/unknown"},
        }.items()
    }

    assert {name: (job["status"], job.get("failureCode")) for name, job in ended.items()} == {
        "no output": ("Failed", "BadPermissionsS3Output"),
        "no application": ("Failed", "BadPermissionsSimulationApplication"),
        "no data": ("Failed", "BadPermissionsS3Object"),
        "no such keys": ("Failed", "BadPermissionsUserCredentials"),
        "no such role": ("Failed", "BadPermissionsUserCredentials"),
    }
    assert "role/unknown is not in the roles file" in ended["no such role"]["failureReason"]


def test_a_users_own_values_win(tmp_path: Path, s3_server: S3Server, bucket: str, prefect_server: str) -> None:
    keys = user(s3_server, reads=[f"{bucket}/in/*"], writes=[f"{bucket}/out/*"])
    service = open_service(tmp_path / "home", s3_server.environ(), role_with_keys(f"{ARN}/nightly", keys))
    own = {"AWS_ENDPOINT_URL_S3": "http://127.0.0.1:1", "AWS_REGION": "eu-west-1"}
    program = "import os; print(os.environ['AWS_ENDPOINT_URL_S3'], os.environ['AWS_REGION'])"

    job = run(service, tmp_path, bucket, program, launch={"environmentVariables": own})

    assert log_of(service, job).split() == ["http://127.0.0.1:1", "eu-west-1"]


def test_in_a_folder_a_role_confines_a_job_to_its_places(tmp_path: Path, prefect_server: str) -> None:
    role = f'arn = "{ARN}/NAME"\nread = ["shared/in/*"]\n'
    nightly = role.replace("NAME", "nightly") + 'write = ["shared/out/*"]\n'
    service = open_service(tmp_path / "home", {}, role.replace("NAME", "reader"), nightly)
    program = "import os; print([name for name in os.environ if name.startswith('AWS_E') or name == 'AWS_CONFIG_FILE'])"

    good, bad = (run(service, tmp_path, "shared", program, iamRole=f"{ARN}/{name}") for name in ("nightly", "reader"))

    assert good["status"] == "Completed"
    assert json.loads(log_of(service, good).replace("'", '"')) == [], "there is no S3 server to lead to"
    assert (bad["status"], bad["failureCode"]) == ("Failed", "BadPermissionsS3Output")


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
def test_an_export_writes_as_its_role_and_reads_worlds_as_the_service(
    tmp_path: Path, s3_server: S3Server, bucket: str, prefect_server: str
) -> None:
    from helpers.small_flat import BODY

    service = open_service(
        tmp_path / "home",
        s3_server.environ(),
        role_with_keys(f"{ARN}/nightly", user(s3_server, writes=[f"{bucket}/out/*"])),
        role_with_keys(f"{ARN}/reader", user(s3_server, reads=[f"{bucket}/*"])),
    )
    template = call("CreateWorldTemplate", {"name": "flat", "templateBody": json.dumps(BODY)}, service)["arn"]
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count, "seed": 7}, service)
    generated = registry()["CreateWorldGenerationJob"].perform(job["arn"], service)
    [world] = generated["finishedWorldsSummary"]["succeededWorlds"]

    def export(role: str) -> dict[str, Any]:
        request = {"worlds": [world], "outputLocation": {"s3Bucket": bucket, "s3Prefix": "out"}, "iamRole": role}
        made = call("CreateWorldExportJob", request, service)
        return registry()["CreateWorldExportJob"].perform(made["arn"], service)

    assert export(f"{ARN}/nightly")["status"] == "Completed"
    for role in ("reader", "unknown"):
        refused = export(f"{ARN}/{role}")
        assert (refused["status"], refused["failureCode"]) == ("Failed", "AccessDenied"), role


def pack_sdk(archive: Path, folder: Path) -> None:
    """Packs boto3 as it is installed here, with what it needs for S3."""
    [packages] = [Path(each) for each in site.getsitepackages()]

    def left_out(where: str, names: list[str]) -> set[str]:
        data = Path(where) == packages / "botocore" / "data"
        return {name for name in names if name == "__pycache__" or (data and name[0] not in "_s" and "." not in name)}

    for name in SDK:
        if (packages / name).is_dir():
            shutil.copytree(packages / name, folder / name, ignore=left_out)
        else:
            shutil.copy(packages / name, folder / name)
    pack_tar_gz(folder, archive)


@pytest.mark.deep
@pytest.mark.parametrize("kind", ["keys", "assumed"])
def test_unchanged_s3_code_in_a_container_acts_as_its_role(
    tmp_path: Path,
    request: pytest.FixtureRequest,
    real_engine: RealEngine,
    prefect_server: str,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
) -> None:
    """Its boto3 is a data source, which the role reads as well; keys of an assumed role come by a process."""
    for name, value in {**real_engine.environ, "ROBOMAKER_CONTAINER_ENGINE": real_engine.program}.items():
        monkeypatch.setenv(name, value)
    server: S3Server = request.getfixturevalue("s3_server" if kind == "keys" else "role_server")
    bucket, folder, arn = "role-a", "a", f"{ARN}/JobA"
    role = f'arn = "{arn}"\nassume_role = "itself"\n'
    if kind == "keys":
        bucket = f"roles-{uuid4().hex[:12]}"
        role = role_with_keys(arn, user(server, writes=[f"{bucket}/{folder}/*"]))
    service = open_service(tmp_path / "home", server.environ(), role)
    service.store.ensure_bucket(bucket)
    (tmp_path / "sdk").mkdir()
    pack_sdk(tmp_path / "sdk.tar.gz", tmp_path / "sdk")
    service.store.put_file(bucket, f"{folder}/sdk.tar.gz", tmp_path / "sdk.tar.gz")
    application = {
        "name": "uploads",
        "environment": {"uri": real_engine.add_image("USER robo", python=True)},
        "robotSoftwareSuite": {"name": "General"},
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
    }
    call("CreateSimulationApplication", application, service)
    variables = {
        "CODE": IN_A_CONTAINER,
        "BUCKET": bucket,
        "FOLDER": folder,
        "PYTHONPATH": f"/opt/robomaker/datasources/sdk/{folder}/sdk",
    }
    launch = {
        "command": ["python3", "-c", "import os; exec(os.environ['CODE'])"],
        "environmentVariables": variables,
    }
    order = {
        "maxJobDurationInSeconds": 100,
        "iamRole": arn,
        "compute": {"simulationUnitLimit": 1},
        "outputLocation": {"s3Bucket": bucket, "s3Prefix": folder},
        "simulationApplications": [{"application": "uploads", "launchConfig": launch}],
        "dataSources": [{"name": "sdk", "type": "Archive", "s3Bucket": bucket, "s3Keys": [f"{folder}/sdk.tar.gz"]}],
    }

    job = registry()["CreateSimulationJob"].perform(call("CreateSimulationJob", order, service)["arn"], service)

    assert job["status"] == "Completed", job["failureReason"]
    assert service.store.get_bytes(bucket, f"{folder}/note") == b"from inside"
    assert "refused: " in log_of(service, job)
    assert "AccessDenied" in log_of(service, job)
