"""SDKs of every age in jobs call what is served here, and nothing of AWS with keys that are good here only."""

import json
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.client_environments import debian_aws_cli, old_botocore
from helpers.endpoint_here import ServeHere
from helpers.roles import role_with_keys, roles_file, user
from helpers.s3_server import S3Server
from helpers.small_flat import ROLE

from prefect_robomaker.deployments.service_model.installation import DATA_PATH
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.deep

Order = Callable[..., dict[str, Any]]
SETTING = "ROBOMAKER_JOBS_CALL_AWS"
CALLS = """
import json, os
import botocore.session
from botocore.config import Config
session, job = botocore.session.get_session(), os.environ["AWS_ROBOMAKER_SIMULATION_JOB_ARN"]
quick = Config(retries={"max_attempts": 0}, connect_timeout=5)
client = lambda name: session.create_client(name, config=quick)
said = {}
for name, operation, members in (
    ("kinesis", "list_streams", {}), ("sqs", "list_queues", {}), ("sts", "get_caller_identity", {}),
    ("iam", "list_users", {}), ("ec2", "describe_instances", {}), ("lambda", "list_functions", {}),
    ("route53", "list_hosted_zones", {}), ("s3", "list_buckets", {}), ("cloudwatch", "list_metrics", {}),
    ("polly", "describe_voices", {}),
):
    made = client(name)
    said[name] = [made.meta.endpoint_url, ""]
    if os.environ.get("ONLY_LOOK"):
        continue
    try:
        getattr(made, operation)(**members)
        said[name][1] = "done"
    except Exception as error:
        said[name][1] = str(error)
print(json.dumps(said), flush=True)
client("robomaker").tag_resource(resourceArn=job, tags={"by": botocore.__version__})
client("robomaker").cancel_simulation_job(job=job)
"""
VERSIONS = ["1.29.27", "1.40.60"]


def once_each(first: Any, second: Any) -> list[Any]:
    """Pairs of a version and a value, in which each of them is once; the other pairs are for endurance runs."""
    old, young = VERSIONS
    others = [
        pytest.param(old, second, marks=pytest.mark.endurance),
        pytest.param(young, first, marks=pytest.mark.endurance),
    ]
    return [(old, first), (young, second), *others]


@pytest.fixture
def own_launcher(monkeypatch: pytest.MonkeyPatch) -> Launcher:
    """A launcher of this test's own, whose jobs see the programs that tests have installed."""
    monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")
    own = Launcher()
    monkeypatch.setattr(job_runs, "launcher", lambda: own)
    return own


def performed(service: Service, request: Mapping[str, Any]) -> tuple[str, Any]:
    """ARN of a job that was performed, and the JSON that it printed."""
    arn = call("CreateSimulationJob", dict(request), service)["arn"]
    perform_job(arn, service)
    place = service.catalog.get(arn).document["outputs"]
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/simulation.stdout.log").decode()
    return arn, json.loads(log.splitlines()[0]) if log.startswith("{") else log


def found(monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    """Has this process know of the endpoint as `robomaker serve` has its job worker know."""
    monkeypatch.setenv("AWS_ENDPOINT_URL_ROBOMAKER", url)
    monkeypatch.setenv("AWS_DATA_PATH", str(DATA_PATH))


@pytest.mark.parametrize("version", VERSIONS)
def test_a_job_calls_the_service_and_nothing_of_aws(
    version: str,
    service: Service,
    order_command: Order,
    serve_here: ServeHere,
    own_launcher: Launcher,
    monkeypatch: pytest.MonkeyPatch,
    pytestconfig: pytest.Config,
) -> None:
    python = old_botocore(pytestconfig, version) / "python"
    script, variables = f'{python} -c "$A$B"', {"A": CALLS[:900], "B": CALLS[900:]}
    with own_launcher, serve_here() as served:
        found(monkeypatch, served.url)

        arn, said = performed(service, order_command(script, variables=variables))

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert (job["status"], job["tags"]) == ("Canceled", {"by": version}), (job, said)
    assert {name: url for name, (url, _) in said.items() if not url.startswith(served.url)} == {}
    assert {name: text for name, (_, text) in said.items() if f"set {SETTING}=1" not in text} == {}


@pytest.mark.parametrize(("version", "with_endpoint"), once_each(True, False))
def test_keys_of_a_role_reach_the_object_store_and_the_service_only(
    version: str,
    with_endpoint: bool,
    tmp_path: Path,
    s3_server: S3Server,
    order_command: Order,
    serve_here: ServeHere,
    own_launcher: Launcher,
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    pytestconfig: pytest.Config,
) -> None:
    request = order_command("true")
    for name in ("results", "applications"):
        if name not in {each["Name"] for each in s3_server.client("s3").list_buckets()["Buckets"]}:
            s3_server.client("s3").create_bucket(Bucket=name)
    archive = service.store.get_bytes("applications", "sleeper.tar.gz")
    s3_server.client("s3").put_object(Bucket="applications", Key="sleeper.tar.gz", Body=archive)
    keys = user(s3_server, reads=["applications/*"], writes=["results/*"])
    variables = {
        **s3_server.environ(),
        "ROBOMAKER_HOME": str(service.settings.home),
        "ROBOMAKER_ROLES_FILE": str(roles_file(tmp_path, role_with_keys(ROLE, keys))),
    }
    of_roles = Service.open(Settings.from_environment(variables), variables)
    python = old_botocore(pytestconfig, version) / "python"
    launch = request["simulationApplications"][0]["launchConfig"]
    launch["environmentVariables"] = {"SCRIPT": f'{python} -c "$A$B"', "A": CALLS[:900], "B": CALLS[900:]}
    with own_launcher, serve_here() as served:
        monkeypatch.delenv("AWS_ENDPOINT_URL_ROBOMAKER", raising=False)
        if with_endpoint:
            found(monkeypatch, served.url)

        arn, said = performed(of_roles, request)

    job = of_roles.catalog.get(arn)
    assert job.status == ("Canceled" if with_endpoint else "Failed"), said
    assert "amazonaws.com" not in json.dumps(said)
    assert said.pop("s3")[0] == s3_server.endpoint
    assert {name: text for name, (_, text) in said.items() if SETTING not in text} == {}
    if not with_endpoint:  # the service has no address in this job; it is not looked for at AWS either
        assert SETTING in str(of_roles.catalog.get(arn).document)


@pytest.mark.parametrize(("version", "by"), once_each("setting", "keys of the job"))
def test_jobs_call_aws_where_they_may(
    version: str,
    by: str,
    settings: Settings,
    service: Service,
    order_command: Order,
    serve_here: ServeHere,
    own_launcher: Launcher,
    monkeypatch: pytest.MonkeyPatch,
    pytestconfig: pytest.Config,
) -> None:
    """Only addresses are looked at: nothing is sent to AWS."""
    python = old_botocore(pytestconfig, version) / "python"
    variables = {"A": CALLS[:900], "B": CALLS[900:], "ONLY_LOOK": "1"}
    if by == "setting":
        service = Service.open(settings.model_copy(update={"jobs_call_aws": True}), {})
    else:
        variables |= {"AWS_ACCESS_KEY_ID": "of-its-own", "AWS_SECRET_ACCESS_KEY": "of-its-own"}
    with own_launcher, serve_here() as served:
        found(monkeypatch, served.url)

        arn, said = performed(service, order_command(f'{python} -c "$A$B"', variables=variables))

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Canceled", ("the service is found all the same", job)
    hosts = {name: url.removeprefix("https://").rstrip("/") for name, (url, _) in said.items()}
    assert hosts["kinesis"] == "kinesis.us-east-1.amazonaws.com"
    assert (hosts["iam"], hosts["route53"]) == ("iam.amazonaws.com", "route53.amazonaws.com")
    assert hosts["cloudwatch"] == "monitoring.us-east-1.amazonaws.com"
    assert hosts["s3"] in ("s3.amazonaws.com", "s3.us-east-1.amazonaws.com")
    assert all("amazonaws.com" in host for host in hosts.values())


def test_debians_aws_cli_cancels_and_tags_its_job(
    service: Service,
    order_command: Order,
    serve_here: ServeHere,
    own_launcher: Launcher,
    monkeypatch: pytest.MonkeyPatch,
    pytestconfig: pytest.Config,
) -> None:
    aws = shlex.join(debian_aws_cli(pytestconfig))
    script = """
      $CLI --version; $CLI kinesis list-streams 2>&1
      $CLI robomaker tag-resource --resource-arn $AWS_ROBOMAKER_SIMULATION_JOB_ARN --tags by=cli
      $CLI robomaker cancel-simulation-job --job $AWS_ROBOMAKER_SIMULATION_JOB_ARN
    """
    with own_launcher, serve_here() as served:
        found(monkeypatch, served.url)

        arn, said = performed(service, order_command(script, variables={"CLI": aws}))

    assert said.startswith("aws-cli/2.9.19")
    assert f"set {SETTING}=1" in said
    assert service.catalog.get(arn).status == "Canceled", said
    assert dict(service.catalog.get(arn).tags) == {"by": "cli"}
