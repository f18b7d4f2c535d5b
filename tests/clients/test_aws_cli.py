"""The last AWS CLI that has the service: with its own model, and with ours from `~/.aws/models`."""

import datetime
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.client_checks import ERRORS, check_simulations, check_worlds
from helpers.client_environments import run_client

from prefect_robomaker.deployments.cli.main import main

_SCRIPT = str(Path(__file__).parent / "aws_cli.sh")
# In its first versions exit codes told less.
_REFUSED = (254, 255)

Script = Callable[..., dict[str, Any]]

pytestmark = [pytest.mark.slow, pytest.mark.deep, pytest.mark.timeout(900)]  # every command is a process of its own


@pytest.fixture
def script(old_programs: Path, place: Any, wanted: dict[str, Any], tmp_path: Path) -> Script:
    """Runs a part of the script, and reads what it was told."""
    told = tmp_path / "told"
    told.mkdir()
    (tmp_path / "template.json").write_text(wanted["body"])
    (source,) = wanted["sources"]

    def run(part: str, **more: str) -> dict[str, Any]:
        environ = {name: value for name, value in place.environ.items() if "ENDPOINT" not in name}
        environ |= {"HOME": str(tmp_path), "OUT": str(told), "ENDPOINT": place.served.url, **more}
        environ |= {"NAME": wanted["name"], "BUCKET": wanted["bucket"], "ROLE": wanted["role"]}
        environ["SOURCE"] = ",".join(f"{name}={value}" for name, value in source.items())
        environ["PATH"] = f"{old_programs}:{os.environ['PATH']}"
        run_client([_SCRIPT, part], environ, folder=tmp_path)
        answers = {file.stem: _answer(file.read_text()) for file in told.glob("*.json")}
        return answers | {file.stem: _refusal(file.read_text()) for file in told.glob("*.error")}

    return run


@pytest.mark.endurance  # seventeen processes: botocore has them in test_boto3.py, the command's own ways are below
def test_worlds_are_made_listed_exported_and_deleted(script: Script, place: Any, wanted: dict[str, Any]) -> None:
    check_worlds(script("worlds"), wanted, place.objects)


def test_jobs_and_batches_run_to_their_end(script: Script, place: Any, wanted: dict[str, Any], tmp_path: Path) -> None:
    """Its cancellations are in journeys/simulation_jobs/test_sdks_of_all_ages.py."""
    config = tmp_path / "config"
    config.write_text("[default]\ncli_timestamp_format = iso8601\n")

    told = script("simulations", AWS_CONFIG_FILE=str(config))

    check_simulations(told, wanted, place.objects)
    for step in ("exists", "mismatch"):
        check_refused(told, step)


def test_errors_are_told_by_name_and_exit_code(script: Script, place: Any) -> None:
    for name in "ab":
        place.served.call("CreateWorldTemplate", {"name": name, "templateBody": '{"Version": "1"}'})

    told = script("errors")

    for step in ("missing", "invalidBody", "tooLarge"):
        check_refused(told, step)
    assert len(told["page"]["templateSummaries"]) == 1
    assert told["page"]["NextToken"]


def test_the_cli_waits_with_our_model(
    script: Script, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["sdk-model", "--install"]) == 0
    assert f"written {tmp_path}/.aws/models/robomaker/2018-06-29/service-2.json" in capsys.readouterr().out

    assert script("waiting")["generated"]["status"] == "Completed"


def check_refused(told: dict[str, Any], step: str) -> None:
    name, message = ERRORS[step]
    assert told[step]["code"] == name
    assert message in told[step]["message"]
    assert told[step]["exit"] in _REFUSED


def _answer(text: str) -> Any:
    return json.loads(text, object_hook=_with_moments) if text.strip() else {}


def _with_moments(members: dict[str, Any]) -> dict[str, Any]:
    """The same, with moments as the other clients tell them."""
    return {name: {"time": _seconds(value)} if name.endswith("At") else value for name, value in members.items()}


def _seconds(moment: float | str) -> float:
    return datetime.datetime.fromisoformat(moment).timestamp() if isinstance(moment, str) else moment


def _refusal(text: str) -> dict[str, Any]:
    *words, code = text.strip().splitlines()
    found = re.fullmatch(r"An error occurred \((\w+)\) when calling the \w+ operation: (.*)", "\n".join(words).strip())
    assert found, text
    return {"code": found[1], "message": found[2], "exit": int(code)}
