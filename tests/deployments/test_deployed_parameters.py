"""A deployed specification's own parameters: in Prefect's form and command, and in the records of runs by a worker."""

import json
import os
import subprocess
import sys
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import process_worker, wait_for
from helpers.receivers import Webhook

Robomaker = Callable[..., Any]

SPEC = """\
version: 1
name: {name}
parameters:
  label: {{default: flat, pattern: "^[a-z ]*$", description: Name of the template}}
  worlds: {{type: integer, minimum: 1, maximum: 50, default: 4}}
  {arm}: {{enum: [a, b]}}
steps:
  flat:
    operation: CreateWorldTemplate
    input:
      name: ${{{{ parameters.label }}}} ${{{{ parameters.worlds }}}}
      templateBody: "{{}}"
      tags: {{arm: "${{{{ parameters.{arm} }}}}"}}
  again:
    operation: DescribeWorldTemplate
    input: {{template: "${{{{ flat.arn }}}}"}}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A specification whose name no other test uses."""
    path = tmp_path / "flats.yaml"
    path.write_text(SPEC.format(name=f"flats-{uuid.uuid4().hex[:8]}", arm="arm"))
    return path


def deployed(client: Any, path: Path) -> Any:
    name = path.read_text().splitlines()[1].removeprefix("name: ")
    return client.read_deployment_by_name(f"RunPipeline/{name}")


def renamed(path: Path) -> None:
    """Changes the specification's parameter `arm`, after a run of it was ordered."""
    path.write_text(path.read_text().replace("  arm: ", "  side: ").replace("parameters.arm", "parameters.side"))


def test_the_form_has_the_parameters_with_types_defaults_and_descriptions(
    robomaker: Robomaker, client: Any, pool: str, path: Path
) -> None:
    ended = robomaker("deploy", path, "--pool", pool, "--set", "worlds=7")

    made = deployed(client, path)
    assert ended.code == 0, ended.err
    assert ended.out == f"RunPipeline/{made.name}  created, with label=flat worlds=7, each run needs arm\n"
    assert f"prefect deployment run RunPipeline/{made.name} --param arm=… --watch" in ended.err
    assert made.parameters == {"text": path.read_text(), "origin": str(path), "worlds": 7}
    schema = made.parameter_openapi_schema
    properties = {name: {**each} for name, each in schema["properties"].items()}
    assert sorted(properties, key=lambda name: properties[name]["position"]) == [
        *("label", "worlds", "arm", "spec", "text", "origin", "reuse", "continues")
    ]
    for each in properties.values():
        del each["position"]
    assert properties["label"] == {
        "type": "string",
        "title": "label",
        "default": "flat",
        "pattern": "^[a-z ]*$",
        "description": "Name of the template",
    }
    assert properties["worlds"] == {"type": "integer", "title": "worlds", "default": 4, "minimum": 1, "maximum": 50}
    assert properties["arm"] == {"type": "string", "title": "arm", "enum": ["a", "b"]}
    assert schema["required"] == ["arm"]


def test_a_schedule_without_a_value_is_refused_and_one_with_it_is_not(
    robomaker: Robomaker, client: Any, pool: str, path: Path
) -> None:
    schedule = ("--schedule", "0 2 * * *")
    ended = robomaker("deploy", path, "--pool", pool, *schedule)
    assert ended.code == 2
    assert "runs by itself (0 2 * * * UTC), and has no value for arm; --set arm=…, or defaults" in ended.err

    ended = robomaker("deploy", path, "--pool", pool, *schedule, "--set", "arm=b")
    assert ended.code == 0, ended.err
    assert "created, runs at 0 2 * * * UTC, with label=flat worlds=4 arm=b" in ended.out
    assert deployed(client, path).parameters["arm"] == "b"

    ended = robomaker("deploy", path, "--pool", pool)  # the schedule stays, and the value would be gone
    assert ended.code == 2
    assert deployed(client, path).parameters["arm"] == "b"


def test_wrong_values_are_refused_before_anything_is_deployed(robomaker: Robomaker, pool: str, path: Path) -> None:
    ended = robomaker("deploy", path, "--pool", pool, "--set", "worlds=77")
    assert ended.code == 2
    assert (
        f"{path}:5:12: parameters.worlds: the value given is 77; it has to be a whole number from 1 to 50" in ended.err
    )


def run_with(
    deployment: Any, values: Mapping[str, Any], environ: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Orders a run as a person does."""
    words = [f"--param={name}={value}" for name, value in values.items()]
    command = [sys.executable, "-m", "prefect", "deployment", "run", f"RunPipeline/{deployment.name}", *words]
    return subprocess.run(command, env=environ, capture_output=True, text=True, check=False, timeout=300)


def order(client: Any, deployment: Any, **values: Any) -> None:
    """Orders a run as Prefect's command does, without a process."""
    client.create_flow_run_from_deployment(deployment.id, parameters=values)


def ended_runs(client: Any, deployment: Any, count: int) -> list[Any]:
    """The runs of a deployment, the first ordered first, once so many have ended."""
    from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterId

    chosen = DeploymentFilter(id=DeploymentFilterId(any_=[deployment.id]))

    def look() -> list[Any] | None:
        found = client.read_flow_runs(deployment_filter=chosen)
        is_over = len(found) >= count and all(run.state is not None and run.state.is_final() for run in found)
        return sorted(found, key=lambda run: run.created) if is_over else None

    return wait_for(look, f"the end of {count} runs", 300) or []


def logged(client: Any, run: Any, text: str) -> list[str]:
    """The lines of a run's log, once a text is among them: processes send them in batches."""
    from prefect.client.schemas.filters import LogFilter, LogFilterFlowRunId

    chosen = LogFilter(flow_run_id=LogFilterFlowRunId(any_=[run.id]))
    lines = [each.message for each in client.read_logs(log_filter=chosen)]
    return lines if any(text in line for line in lines) else []


def records(home: Path) -> list[dict[str, Any]]:
    """Records of all runs, by their number of worlds: a worker begins those that wait in any order."""
    found = [json.loads(each.read_text()) for each in (home / "runs").glob("*/run.json")]
    return sorted(found, key=lambda record: record["parameters"]["worlds"])


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_a_worker_runs_it_with_the_values_of_the_order(
    robomaker: Robomaker,
    client: Any,
    pool: str,
    path: Path,
    prefect_server: str,
    tmp_path: Path,
    webhook: Webhook,
) -> None:
    from prefect.exceptions import PrefectHTTPStatusError

    home = tmp_path / "nights"
    environ = {
        **os.environ,
        "PREFECT_API_URL": prefect_server,
        "ROBOMAKER_HOME": str(home),
        "PREFECT_WORKER_QUERY_SECONDS": "1",
        "ROBOMAKER_NOTIFY": f"json://{webhook.address}/hook",
        "ROBOMAKER_NOTIFY_WHEN": "failure",  # in another order, a good run may be a recovery
        "ROBOMAKER_PING_URL": f"http://{webhook.address}/night",
    }
    assert robomaker("deploy", path, "--pool", pool).code == 0
    before = deployed(client, path)
    # Ordered before the file changes, begun after it: the order's text and values go together.
    order(client, before, arm="b", worlds=20)
    renamed(path)
    assert robomaker("deploy", path, "--pool", pool).code == 0
    made = deployed(client, path)

    for wrong, said in (
        ({}, "'side' is a required property"),
        ({"side": "c"}, "'c' is not one of ['a', 'b']"),
        ({"side": "a", "label": "20"}, "'20' does not match"),
    ):
        with pytest.raises(PrefectHTTPStatusError, match="409") as refused:
            order(client, made, **wrong)
        assert said in refused.value.response.json()["detail"]
    assert run_with(made, {"side": "a", "worlds": "21", "label": "the flat"}, environ).returncode == 0
    # The form knows another limit than the text that is run.
    order(client, made, side="a", worlds=4, text=narrower(path))

    log = tmp_path / "worker.log"
    problem = "parameters.worlds: the value given is 4; it has to be a whole number from 1 to 3"
    with process_worker(pool, environ, log):
        runs = ended_runs(client, made, 3)
        # The process of a run sends its last lines after the run has ended, and dies with its worker.
        lines = wait_for(lambda: logged(client, runs[2], problem), "the log of the run")

    told = log.read_text()
    assert [run.state.type.value for run in runs] == ["COMPLETED", "COMPLETED", "FAILED"], told
    refused, one, two = records(home)
    assert one["parameters"] == {"label": "flat", "worlds": 20, "arm": "b"}
    assert two["parameters"] == {"label": "the flat", "worlds": 21, "side": "a"}
    assert [record["steps"][1]["output"]["name"] for record in (one, two)] == ["flat 20", "the flat 21"]
    assert [record["steps"][1]["output"]["tags"] for record in (one, two)] == [{"arm": "b"}, {"arm": "a"}]
    assert two["command"] == [
        *("prefect", "deployment", "run", f"RunPipeline/{made.name}"),
        *("--param=label=the flat", "--param=worlds=21", "--param=side=a"),
    ]
    assert problem in runs[2].state.message
    assert (refused["state"], refused["parameters"]) == ("broken", {"label": "flat", "worlds": 4, "side": "a"})
    assert problem in refused["steps"][0]["error"]
    assert refused["flow_run"] == str(runs[2].id)
    assert refused["command"][3] == f"RunPipeline/{made.name}"
    assert hooked(webhook) == ["/start", "/start", "/start", "", "", "/fail", "/hook"]
    assert not any("Traceback" in line for line in lines), lines


def hooked(webhook: Webhook) -> list[str]:
    """Pings of starts, of good and bad ends, and messages, without the order of the runs."""
    told = [each.removeprefix("/night") for each in webhook.paths]
    return sorted(told, key=["/start", "", "/fail", "/hook"].index)


def narrower(path: Path) -> str:
    """The specification with a narrower limit than the form knows."""
    return path.read_text().replace("maximum: 50, default: 4", "maximum: 3, default: 2")
