"""Applications that go wrong in every way, as real jobs: each ends, says why, and leaves nothing behind."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.runs.provenance import Manifest
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest

SIMULATION, ROBOT, OURS = "SimulationApplicationCrash", "RobotApplicationCrash", "InternalServiceError"
Simulate = Callable[[dict[str, Any]], dict[str, Any]]


@dataclass
class Attack:
    """One hostile job, run to its end."""

    job: dict[str, Any]
    service: Service
    processes: Path

    @property
    def manifest(self) -> Manifest | None:
        """The manifest anywhere below the job's outputs."""
        found = [
            item.key for item in self.service.store.list("results", "attack/") if item.key.endswith("manifest.json")
        ]
        if not found:
            return None
        [key] = found
        return read_manifest(self.service.store, "results", key.removesuffix("/manifest.json"))

    def check_nothing_runs(self) -> None:
        """Checks that every process the application noted is gone, and every one that knows where notes go."""
        noted = [int(line) for line in self.processes.read_text().split()] if self.processes.exists() else []
        assert [pid for pid in noted if _runs(pid)] == []
        mark = f"PROCESSES={self.processes}".encode()
        assert [entry.name for entry in Path("/proc").iterdir() if mark in _environment(entry)] == []


def _runs(pid: int) -> bool:
    try:
        return "(zombie)" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def _environment(entry: Path) -> bytes:
    with suppress(OSError):
        return (entry / "environ").read_bytes()
    return b""


@pytest.fixture
def attack(hostile: Callable[..., dict[str, Any]], service: Service, simulate: Simulate) -> Callable[..., Attack]:
    """Runs a job of the hostile bundle to its end."""

    def run(*attributes: str, **options: Any) -> Attack:
        request = hostile(*attributes, **options)
        noted = request["robotApplications"][0]["launchConfig"]["environmentVariables"]["PROCESSES"]
        return Attack(simulate(request), service, Path(noted))

    return run


@pytest.mark.parametrize(
    ("environment", "agent", "code", "words"),
    [
        pytest.param(
            "hostile.failing_import.x",
            None,
            SIMULATION,
            ("hostile.failing_import", "ZeroDivisionError"),
            marks=pytest.mark.deep,
        ),
        ("hostile.leaving_import.x", None, SIMULATION, ("sys.exit", "I never wanted to be imported")),
        ("hostile.circle.make_environment", None, SIMULATION, ("hostile.circle", "circular import")),
        pytest.param("hostile.arena.clam", None, SIMULATION, ("no clam", "did you mean calm"), marks=pytest.mark.deep),
        pytest.param("hostile.arna.calm", None, SIMULATION, ("no arna", "did you mean arena"), marks=pytest.mark.deep),
        pytest.param(
            "hostle.arena.calm", None, SIMULATION, ("no package hostle", "did you mean hostile"), marks=pytest.mark.deep
        ),
        ("hostile.arena.NoTimeStep", None, SIMULATION, ("step() returned of type tuple", "dm_env.TimeStep")),
        pytest.param(
            "hostile.arena.NoTimeStepAtFirst",
            None,
            SIMULATION,
            ("reset() returned None", "dm_env.TimeStep"),
            marks=pytest.mark.deep,
        ),
        pytest.param(
            "hostile.arena.nothing",
            None,
            SIMULATION,
            ("environment is None", "dm_env.Environment"),
            marks=pytest.mark.deep,
        ),
        pytest.param(
            "hostile.arena.exiting", None, SIMULATION, ("exit code 0 before the run was over",), marks=pytest.mark.deep
        ),
        pytest.param("hostile.arena.crashing", None, SIMULATION, ("SIGSEGV",), marks=pytest.mark.deep),
        pytest.param("hostile.arena.piping_log", None, SIMULATION, ("now read my log",), marks=pytest.mark.deep),
        ("hostile.arena.linking_log", None, SIMULATION, ("now read my log",)),
        ("hostile.arena.CyclicResult", None, SIMULATION, ("run_result()", "JSON", "Circular")),
        (None, "hostile.arena.no_agent", ROBOT, ("agent is of type str", "function of a time step")),
        pytest.param(None, "hostile.arena.agnt", ROBOT, ("no agnt", "did you mean agent"), marks=pytest.mark.deep),
    ],
)
def test_what_goes_wrong_fails_the_job_with_its_reason_and_without_a_manifest(
    attack: Callable[..., Attack], environment: str | None, agent: str | None, code: str | None, words: tuple[str, ...]
) -> None:
    ended = attack(environment or "hostile.arena.calm", agent or "hostile.arena.agent")

    assert (ended.job["status"], ended.job["failureCode"]) == ("Failed", code or ended.job["failureCode"])
    for word in words:
        assert word in ended.job["failureReason"]
    assert "root:" not in ended.job["failureReason"]
    assert ended.manifest is None
    assert not list(ended.service.settings.home.glob("jobs/*/*/work"))
    ended.check_nothing_runs()


@pytest.mark.parametrize(("environment", "why"), [("deleting", "No such file"), ("replacing", "")])
def test_what_takes_the_output_folder_away_fails_the_job(
    attack: Callable[..., Attack], environment: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")  # in a box it cannot
    ended = attack(f"hostile.arena.{environment}", "hostile.arena.agent")

    assert (ended.job["status"], ended.job["failureCode"]) == ("Failed", OURS)
    assert "writing the outputs" in ended.job["failureReason"]
    assert why in ended.job["failureReason"]
    assert ended.manifest is None


@pytest.mark.parametrize(
    "environment",
    ["single.make_environment", "hostile.arena.wandering", "hostile.arena.daemonising"]
    + [
        pytest.param(f"hostile.arena.{name}", marks=pytest.mark.deep)
        for name in ("NonsenseSpecs", "BoastingResult", "printing")
    ],
)
def test_what_only_looks_bad_completes_and_is_published_whole(attack: Callable[..., Attack], environment: str) -> None:
    ended = attack(environment)

    assert ended.job["status"] == "Completed", ended.job.get("failureReason")
    assert ended.manifest is not None
    assert {"result.json", "recording.mcap", "logs/stdout.log"} <= {file.path for file in ended.manifest.files}
    ended.check_nothing_runs()


@pytest.mark.parametrize(
    ("environment", "left_out"),
    [
        ("linking", "'innocent.txt' is not stored: it is a symbolic link"),
        pytest.param("linking_folders", "'everything' is not stored: it is a symbolic link", marks=pytest.mark.deep),
        pytest.param(
            "piping", "'pipe' is not stored: it is neither a regular file nor a folder", marks=pytest.mark.deep
        ),
        ("forging", "'manifest.json' is not stored: it has the name of the manifest"),
        ("naming", r"'\udcff\udcfe' is not stored: it has a name that no store takes"),
        pytest.param("digging", "is not stored: it is nested more than 100 folders deep", marks=pytest.mark.deep),
    ],
)
def test_what_cannot_be_stored_is_left_out_by_name_and_all_else_is_stored(
    attack: Callable[..., Attack], environment: str, left_out: str
) -> None:
    ended = attack(f"hostile.arena.{environment}")
    assert ended.job["status"] == "Completed"
    assert ended.manifest is not None
    assert {file.path for file in ended.manifest.files} >= {"result.json", "recording.mcap", "logs/stdout.log"}
    (notes,) = (
        item.key for item in ended.service.store.list("results", "attack/") if item.key.endswith("logs/uploads.log")
    )
    text = ended.service.store.get_bytes("results", notes).decode()
    assert left_out in text
    assert "root:" not in text
    ended.check_nothing_runs()


def test_a_step_that_never_returns_ends_at_the_duration_limit_and_is_told(attack: Callable[..., Attack]) -> None:
    ended = attack("hostile.arena.endless", duration_s=5)

    assert ended.job["status"] == "Completed"
    assert ended.manifest is not None
    assert "result.json" in {file.path for file in ended.manifest.files}
    ended.check_nothing_runs()


def test_a_crash_keeps_its_logs_for_people_to_read(attack: Callable[..., Attack], service: Service) -> None:
    ended = attack("hostile.failing_import.x")

    place = service.catalog.get(ended.job["arn"]).document["outputs"]
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stderr.log").decode()
    assert "SPEED = 1 / 0" in log
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, place["bucket"], place["prefix"])


@pytest.mark.usefixtures("known_worlds")
@pytest.mark.parametrize(
    ("agent", "words"), [("dreaming_agent", "nan"), pytest.param("many_armed_agent", "17", marks=pytest.mark.deep)]
)
def test_an_action_that_is_none_is_the_robot_applications_fault(
    attack: Callable[..., Attack], generate: Callable[..., dict[str, Any]], service: Service, agent: str, words: str
) -> None:
    [world] = generate()["finishedWorldsSummary"]["succeededWorlds"]
    request = {"worldConfigs": [{"world": world}], "application": "indoor-navigation"}

    ended = attack(agent=f"hostile.arena.{agent}", launchConfig={}, **request)

    assert (ended.job["status"], ended.job["failureCode"]) == ("Failed", ROBOT)
    assert words in ended.job["failureReason"]
    assert ended.manifest is None
    ended.check_nothing_runs()
