"""Odd surroundings: homes that cannot be used or have odd names, two at once, dead servers, clocks that go back."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.prefect_server.local_server import stop_server
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

MAIN = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
# Root can write to any folder, unless it gives up the right to.
AS_ANYBODY = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override"] if os.geteuid() == 0 else []
Robomaker = Callable[..., tuple[int, str, str]]
SPEC = """\
version: 1
name: quick
steps:
  template: {operation: CreateWorldTemplate, input: {name: flat, templateBody: {Version: "1"}}}
"""
APPLICATION = {
    "name": "mine",
    "robotSoftwareSuite": {"name": "General"},
    "environment": {"uri": "python://package.module"},
}


def environ(**variables: object) -> dict[str, str]:
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PREFECT_")}
    return {**kept, "CI": "true", **{key: str(value) for key, value in variables.items()}}


def command(
    *words: object, cwd: Path | None = None, before: Sequence[str] = (), **variables: object
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*before, *MAIN, *map(str, words)],
        env=environ(**variables),
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=250,
    )


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC)
    path.chmod(0o444)
    return path


@pytest.mark.parametrize("words", [("run", "SPEC"), ("call", "ListWorlds"), ("server", "start")])
@pytest.mark.parametrize("home", ["file", "file/below", "/proc/nowhere"])
def test_a_home_that_cannot_be_used_is_told_in_one_line(
    tmp_path: Path, spec: Path, robomaker: Robomaker, home: str, words: tuple[str, ...]
) -> None:
    (tmp_path / "file").write_text("no folder")

    code, out, err = robomaker(tmp_path / home, *(spec if word == "SPEC" else word for word in words))

    assert (code, out) == (2, "")
    [line] = err.splitlines()
    assert str(tmp_path / home) in line
    assert "set ROBOMAKER_HOME to a folder you can write to" in line


@pytest.mark.skipif(os.geteuid() == 0 and shutil.which("setpriv") is None, reason="needs setpriv, of util-linux")
def test_a_home_without_the_right_to_write(tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir(mode=0o555)

    ended = command("call", "ListWorlds", before=AS_ANYBODY, ROBOMAKER_HOME=home)

    assert ended.returncode == 2
    assert "cannot be written to" in ended.stderr


@pytest.mark.parametrize("name", ["with space", "größe", "a#b%20c", "what?", "-dash"])
def test_a_home_may_have_an_odd_name_and_be_relative(
    tmp_path: Path, robomaker: Robomaker, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)

    code, _, err = robomaker(name, "call", "CreateRobotApplication", "--input", json.dumps(APPLICATION))

    assert code == 0, err
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name / "catalog.db").exists()


@pytest.mark.deep
def test_a_command_of_its_own_may_have_an_odd_home(tmp_path: Path) -> None:
    made = command(
        "call", "CreateRobotApplication", "--input", json.dumps(APPLICATION), cwd=tmp_path, ROBOMAKER_HOME="a#b%20c"
    )

    assert made.returncode == 0, made.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a#b%20c"]


def test_a_dead_prefect_server_is_named_and_none_is_started(tmp_path: Path, spec: Path) -> None:
    home = tmp_path / "home"

    ended = command("run", spec, ROBOMAKER_HOME=home, PREFECT_API_URL="http://127.0.0.1:9/api")

    assert (ended.returncode, ended.stdout) == (2, "")
    [line] = ended.stderr.splitlines()
    assert "PREFECT_API_URL is 'http://127.0.0.1:9/api'" in line
    assert not home.exists()


@pytest.fixture
def fresh_home(tmp_path: Path) -> Iterator[Path]:
    """A home whose server, once started, is stopped at the end."""
    home = tmp_path / "fresh home"
    yield home
    stop_server(Settings.from_environment({"ROBOMAKER_HOME": str(home)}))


@pytest.mark.slow
@pytest.mark.deep
def test_two_first_runs_at_once_share_one_server_and_both_succeed(fresh_home: Path, spec: Path) -> None:
    start = [*MAIN, "run", str(spec), "-o", "json"]
    runs = [
        subprocess.Popen(
            start, env=environ(ROBOMAKER_HOME=fresh_home), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    ended = [run.communicate(timeout=250) for run in runs]

    assert [run.returncode for run in runs] == [0, 0], ended
    assert len(list((fresh_home / "runs").iterdir())) == 2
    servers = [path for path in Path("/proc").glob("[0-9]*/cmdline") if _serves(path, fresh_home)]
    assert len(servers) == 1


def _serves(command_line: Path, home: Path) -> bool:
    try:
        inside = command_line.with_name("cwd").readlink() == home / "prefect"
        return inside and b"deployments.prefect_server\0--port" in command_line.read_bytes()
    except OSError:
        return False


@pytest.mark.deep
def test_of_processes_that_create_one_name_exactly_one_wins(settings: Settings) -> None:
    start = [*MAIN, "call", "CreateRobotApplication", "--input", json.dumps(APPLICATION)]
    variables = environ(ROBOMAKER_HOME=settings.home)
    calls = [
        subprocess.Popen(start, env=variables, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(5)
    ]
    ended = [each.communicate(timeout=250) for each in calls]

    assert sorted(each.returncode for each in calls) == [0] + [2] * 4, ended
    assert sum("ResourceAlreadyExistsException" in errors for _, errors in ended) == 4
    [winner] = [json.loads(answer)["arn"] for answer, _ in ended if answer]
    applications = Service.open(settings, {}).catalog.list("robot-application").resources
    assert [each.arn for each in applications if each.name == "mine"] == [winner]


def test_a_clock_that_goes_backwards_upsets_nothing(
    service: Service, order: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    moments = iter(datetime(2030, 1, 1, tzinfo=UTC) - timedelta(hours=hours) for hours in range(1000))
    backwards = replace(service, clock=lambda: next(moments))
    job = call("CreateSimulationJob", order(), backwards)

    ended = registry()["CreateSimulationJob"].perform(job["arn"], backwards)

    assert ended["status"] == "Completed"
    assert ended["simulationTimeMillis"] >= 0


def test_a_world_of_a_job_that_has_not_made_it_yet_is_not_found(
    service: Service, template: str, order: Callable[..., dict[str, Any]]
) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)
    world = job["arn"].replace(":world-generation-job/", ":world/") + "/world-1"
    for reference, words in ((world, world), (job["arn"], "give the ARN of a world")):
        request = order()
        request["simulationApplications"][0]["worldConfigs"] = [{"world": reference}]
        with pytest.raises(ResourceNotFoundException, match=words):
            call("CreateSimulationJob", request, service)
    assert service.catalog.list("simulation-job").resources == ()
