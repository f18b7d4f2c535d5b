"""deploy and pool-template: what they make on a real Prefect server, and what they say of what they cannot make."""

import json
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.prefect_server import server_settings

from prefect_robomaker.deployments.cli.prefect_server import SHELL_SETUP
from prefect_robomaker.tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE

SPEC = """\
version: 1
name: {name}
description: Looks at a flat.
steps:
  flat: {{operation: CreateWorldTemplate, input: {{name: flat, templateBody: "{{}}"}}}}
"""
Robomaker = Callable[..., Any]


@pytest.fixture
def named(tmp_path: Path) -> Path:
    """A specification whose name no other test uses."""
    path = tmp_path / "flats.yaml"
    path.write_text(SPEC.format(name=f"flats-{uuid.uuid4().hex[:8]}"))
    return path


def deployed(client: Any, path: Path) -> Any:
    name = path.read_text().splitlines()[1].removeprefix("name: ")
    return client.read_deployment_by_name(f"RunPipeline/{name}")


def test_a_specification_becomes_a_deployment_that_keeps_it(
    robomaker: Robomaker, client: Any, pool: str, named: Path
) -> None:
    ended = robomaker("deploy", named, "--pool", pool, "--tag", "lab", "--env", "ROBOMAKER_BUCKET=runs")

    made = deployed(client, named)
    assert (ended.code, ended.out) == (0, f"RunPipeline/{made.name}  created\n")
    assert made.parameters == {"text": named.read_text(), "origin": str(named)}
    assert made.description.startswith("Looks at a flat.\n\n1. `flat`: CreateWorldTemplate")
    assert made.tags == ["robomaker", "specification", "lab"]
    assert made.work_pool_name == pool
    assert made.job_variables == {"env": {"ROBOMAKER_BUCKET": "runs"}}
    assert made.entrypoint == "prefect_robomaker.flows.pipelines.RunPipeline"
    assert not made.pull_steps
    assert f"prefect deployment run RunPipeline/{made.name}" in ended.err
    assert f"prefect worker start --pool {pool}" in ended.err


def test_deploying_again_changes_it_in_place_and_keeps_its_schedule(
    robomaker: Robomaker, client: Any, pool: str, named: Path
) -> None:
    at_two = ("--schedule", "0 2 * * *", "--timezone", "Europe/Berlin")
    first = robomaker("deploy", named, "--pool", pool, *at_two)
    before = deployed(client, named)
    named.write_text(named.read_text() + "# changed\n")

    again = robomaker("deploy", named, "--pool", pool)

    after = deployed(client, named)
    assert first.out.endswith("created, runs at 0 2 * * * Europe/Berlin\n")
    assert again.out.endswith("updated, runs at 0 2 * * * Europe/Berlin\n")
    assert after.id == before.id
    assert after.version != before.version
    assert after.parameters["text"].endswith("# changed\n")
    (schedule,) = after.schedules
    # A night that is due while the last one runs waits for it.
    assert after.global_concurrency_limit.limit == RUNS_AT_ONCE
    assert after.concurrency_options == OVERLAP
    assert (schedule.schedule.cron, schedule.schedule.timezone, schedule.active) == (
        "0 2 * * *",
        "Europe/Berlin",
        True,
    )

    without = robomaker("deploy", named, "--pool", pool, "--no-schedule", "-o", "json")

    (row,) = json.loads(without.out)["deployments"]
    assert (row["id"], row["change"], row["schedules"]) == (str(after.id), "updated", [])
    assert deployed(client, named).schedules == []


def test_the_job_worker_of_a_pool_is_deployed_under_the_name_of_the_pool(
    robomaker: Robomaker, client: Any, pool: str
) -> None:
    from prefect_robomaker.tasks.execution.dead_flow_runs import AUTOMATION

    for each in client.read_automations_by_name(AUTOMATION):
        client.delete_automation(each.id)

    ended = robomaker("deploy", "--job-worker", "--pool", pool, "--env", "ROBOMAKER_MAX_JOBS=3")

    made = client.read_deployment_by_name(f"RunJobWorker/{pool}")
    assert (ended.code, ended.out) == (0, f"RunJobWorker/{pool}  created\n")
    assert (made.work_pool_name, made.tags) == (pool, ["robomaker", "job-worker"])
    assert made.entrypoint == "prefect_robomaker.flows.pool_job_workers.RunJobWorker"
    assert made.job_variables == {"env": {"ROBOMAKER_MAX_JOBS": "3"}}
    assert made.parameter_openapi_schema["required"] == ["batch"]
    assert f"prefect worker start --pool {pool} --limit 1" in ended.err
    assert f"ROBOMAKER_BACKEND=workers:{pool}" in ended.err
    assert client.read_automations_by_name(AUTOMATION), "what runs on a machine that dies is closed"


def test_a_schedule_that_was_paused_stays_paused(robomaker: Robomaker, client: Any, pool: str, named: Path) -> None:
    robomaker("deploy", named, "--pool", pool, "--schedule", "0 2 * * *")
    made = deployed(client, named)
    client.update_deployment_schedule(made.id, made.schedules[0].id, active=False)

    again = robomaker("deploy", named, "--pool", pool)

    assert again.out.endswith("  updated\n")
    assert [each.active for each in deployed(client, named).schedules] == [False]


def test_settings_come_from_blocks_by_reference(robomaker: Robomaker, client: Any, pool: str, named: Path) -> None:
    from pydantic import SecretStr

    from prefect_robomaker.deployments.blocks import RobomakerCatalog

    RobomakerCatalog(url=SecretStr("sqlite:////data/c.db")).save(pool)

    ended = robomaker("deploy", named, "--pool", pool, "--block", f"robomaker-catalog/{pool}")

    reference = f"{{{{ prefect.blocks.robomaker-catalog.{pool}.url }}}}"
    assert ended.code == 0, ended.err
    assert deployed(client, named).job_variables == {"env": {"ROBOMAKER_CATALOG_URL": reference}}
    missing = robomaker("deploy", named, "--pool", pool, "--block", "robomaker-catalog/nowhere")
    assert (missing.code, "has no such block" in missing.err) == (2, True)


def test_what_comes_with_the_package_is_deployed_by_its_name(
    robomaker: Robomaker, client: Any, pool: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    ended = robomaker("deploy", "quickstart", "--pool", pool, "--name", pool)

    assert ended.code == 0, ended.err
    made = client.read_deployment_by_name(f"RunPipeline/{pool}")
    assert "\nname: quickstart\n" in made.parameters["text"]


def test_a_bundle_that_the_store_lacks_is_told(robomaker: Robomaker, client: Any, pool: str, tmp_path: Path) -> None:
    path = tmp_path / "rover.yaml"
    path.write_text(
        f"""\
version: 1
name: {pool}
steps:
  rover:
    operation: CreateRobotApplication
    input:
      name: rover
      sources: [{{s3Bucket: robomaker, s3Key: applications/rover.tar.gz}}]
      robotSoftwareSuite: {{name: General}}
"""
    )

    ended = robomaker("deploy", path, "--pool", pool)

    assert ended.code == 0
    told = "warning: there is no object 's3://robomaker/applications/rover.tar.gz' in the object store"
    (warning,) = [line for line in ended.err.splitlines() if "warning" in line]
    assert f"{told} ({path}:8:" in warning
    assert warning.endswith("; a run would be refused")
    elsewhere = robomaker("deploy", path, "--pool", pool, "--env", "ROBOMAKER_OBJECT_STORE=/there")
    assert "warning" not in elsewhere.err, "the runs have another store"
    assert (
        "- s3://robomaker/applications/rover.tar.gz"
        in client.read_deployment_by_name(f"RunPipeline/{pool}").description
    )


JOB = """\
version: 1
name: {name}
steps:
  drive:
    operation: CreateSimulationJob
    input:
      maxJobDurationInSeconds: 60
      iamRole: arn:aws:iam::000000000000:role/test
      robotApplications: [{{application: my-robot, launchConfig: {{}}}}]
      simulationApplications:
        - {{application: indoor-navigation, launchConfig: {{}}, worldConfigs: [{{world: gone}}]}}
"""


def test_what_no_catalog_has_is_told_before_the_night(
    robomaker: Robomaker, client: Any, pool: str, tmp_path: Path
) -> None:
    path = tmp_path / "night.yaml"
    path.write_text(JOB.format(name=f"night-{uuid.uuid4().hex[:8]}"))

    ended = robomaker("deploy", path, "--pool", pool, "--schedule", "0 2 * * *")

    assert ended.code == 0, ended.err
    assert deployed(client, path).name in ended.out
    (warning,) = [line for line in ended.err.splitlines() if "warning" in line]
    assert f"warning: there is no robot application 'my-robot' ({path}:9:41); 'gone' is neither ARN" in warning
    assert warning.endswith(f"({path}:11:85); its next run would be refused")
    elsewhere = robomaker("deploy", path, "--pool", pool, "--env", "ROBOMAKER_CATALOG_URL=sqlite:////there/catalog.db")
    assert "warning" not in elsewhere.err, "the runs ask another catalog"


@pytest.mark.deep
def test_all_operations_are_deployed_one_by_one(robomaker: Robomaker, client: Any, pool: str) -> None:
    ended = robomaker("deploy", "--operations", "--pool", pool)

    assert ended.code == 0, ended.err
    assert len(ended.out.splitlines()) == 62
    found = client.read_deployment_by_name("CreateWorldTemplate/create-world-template")
    assert found.work_pool_name == pool
    assert found.tags == ["robomaker", "operation", "world-templates"]
    assert set(found.parameter_openapi_schema["properties"]) >= {"name", "templateBody", "templateLocation", "tags"}


def test_a_pool_that_is_not_there_is_told_with_what_makes_it(
    robomaker: Robomaker, client: Any, pool: str, named: Path
) -> None:
    ended = robomaker("deploy", named, "--pool", pool[:-1])

    assert ended.code == 2
    assert f"--pool is '{pool[:-1]}'" in ended.err
    assert f"`prefect work-pool create {pool[:-1]} --type process` makes one; did you mean '{pool}'?" in ended.err


def test_a_server_of_ones_own_is_told_how_shells_find_it(
    robomaker: Robomaker, client: Any, pool: str, named: Path, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_HOME", str(server_settings().home))
    monkeypatch.delenv("PREFECT_API_URL")
    refused = robomaker("deploy", named, "--pool", pool[:-1])
    monkeypatch.delenv("PREFECT_API_URL")
    made = robomaker("deploy", named, "--pool", pool)

    assert (refused.code, made.code) == (2, 0), refused.err + made.err
    assert SHELL_SETUP in refused.err
    assert f"In each terminal:  {SHELL_SETUP}" in made.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--schedule", "0 0 31 2 *"), "--schedule is '0 0 31 2 *', which never comes"),
        (("--schedule", "60 2 * * *"), "--schedule is '60 2 * * *'; one of its fields is out of range: minute 0-59"),
        (("--schedule", "0 2 * *"), "--schedule is '0 2 * *'; five fields would be right"),
        (("--schedule", "0 2 * * *", "--timezone", "Berlin"), "--timezone is 'Berlin'; an IANA name such as UTC"),
        (("--image", "lab/robots:1"), "is of type process, whose runs have no image"),
        (("--timezone", "UTC"), "--timezone is 'UTC'; it is of use with --schedule only"),
        (("--env", "nothing"), "--env is 'nothing'; NAME=VALUE would be right"),
        (("--name", "a b"), "--name is 'a b'; letters, digits, - and _ would be right"),
    ],
)
def test_what_cannot_be_deployed_is_told(
    robomaker: Robomaker, client: Any, pool: str, named: Path, words: tuple[str, ...], message: str
) -> None:
    ended = robomaker("deploy", named, "--pool", pool, *words)

    assert (ended.code, ended.out) == (2, "")
    assert message in ended.err


def test_problems_of_all_specifications_are_told_with_their_places(robomaker: Robomaker, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(SPEC.format(name=name).replace("CreateWorldTemplate", "MakeWorld"))

    ended = robomaker("deploy", tmp_path / "one.yaml", tmp_path / "two.yaml", "--pool", "any")

    assert ended.code == 2
    for name in ("one", "two"):
        assert f"{tmp_path / name}.yaml:5:21: steps.flat.operation: there is no operation 'MakeWorld'" in ended.err


def test_two_specifications_of_one_name_are_not_deployed(robomaker: Robomaker, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(SPEC.format(name="same"))

    ended = robomaker("deploy", tmp_path / "one.yaml", tmp_path / "two.yaml", "--pool", "any")

    assert ended.code == 2
    assert "are both named 'same'; give one another name" in ended.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "there is nothing to deploy; name a SPEC, or --operations"),
        (("--operations", "--schedule", "0 2 * * *"), "are for a SPEC"),
        (("a.yaml", "b.yaml", "--name", "x"), "--name is 'x'; it is for one SPEC, not 2"),
    ],
)
def test_words_that_do_not_fit_each_other_are_told(robomaker: Robomaker, words: tuple[str, ...], message: str) -> None:
    ended = robomaker("deploy", *words, "--pool", "any")

    assert ended.code == 2
    assert message in ended.err


def test_a_server_that_does_not_answer_is_told(
    robomaker: Robomaker, named: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")

    ended = robomaker("deploy", named, "--pool", "any")

    assert ended.code == 2
    assert "PREFECT_API_URL is 'http://127.0.0.1:1/api', and nothing healthy answers there" in ended.err


def test_the_template_of_a_pool_is_printed(robomaker: Robomaker) -> None:
    ended = robomaker("pool-template", "process", "--env", "ROBOMAKER_BUCKET=runs")

    environment = json.loads(ended.out)["variables"]["properties"]["env"]["default"]
    assert environment["PREFECT_FLOWS_HEARTBEAT_FREQUENCY"] == "30"
    assert environment["ROBOMAKER_BUCKET"] == "runs"
    assert robomaker("pool-template", "docker").code == 2
