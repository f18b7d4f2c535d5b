"""`robomaker flaky`: what it says of jobs that flip, repeat, or cannot be run again as they were."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from helpers.flaky_causes import run_planted, upload
from helpers.swing_fixtures import forget_archives

from prefect_robomaker.schemas.reports.run_record import RunRecord, StepRecord
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz


@pytest.fixture
def home(service: Service) -> Path:
    """The data home of the service that jobs are run with."""
    return service.settings.home


@pytest.fixture
def night(service: Service, home: Path, tmp_path: Path) -> Any:
    """Runs a job with a planted cause, as the only one of a run `night-1`; returns its ARN."""
    upload(service, tmp_path)

    def run(**entry: Any) -> str:
        [arn] = run_planted(entry, service, {})
        folder = home / "runs" / "night-1"
        folder.mkdir(parents=True, exist_ok=True)
        moment = datetime(2026, 3, 2, tzinfo=UTC)
        step = StepRecord(name="drive", operation="CreateSimulationJob", status="Completed", arn=arn)
        record = RunRecord(
            run_id="night-1", name="night", spec_path="night.yaml", state="failed", exit_code=1, started_at=moment,
            ended_at=moment, steps=[step], run_dir=folder,
        )  # fmt: skip
        (folder / "run.json").write_text(record.model_dump_json())
        return arn

    return run


def test_reruns_have_limits(robomaker: Any) -> None:
    ended = robomaker("flaky", "latest", "--reruns", "5")
    assert ended.code == 2
    assert "--reruns is 5; a number from 8 to 20 would be right" in ended.err


@pytest.mark.deep
def test_what_decides_is_said_and_nothing_is_stored(robomaker: Any, night: Any, service: Service) -> None:
    arn = night(choice="unseeded", noise="gauss")
    before = service.catalog.get(arn)

    ended = robomaker("flaky", "night-1", "--job", arn)

    assert ended.code == 1
    assert "1 job, up to 20 reruns of each: about" in ended.err
    assert "Randomness that no seed repeats decides" in ended.out
    assert "It is robot code: the simulation repeats bit by bit under the same commands." in ended.out
    assert "First difference at 0.00 s in the command velocity" in ended.out
    assert service.catalog.get(arn) == before
    assert list(service.folder("scratch").iterdir()) == []
    assert [path.name for path in (service.settings.home / "runs").iterdir()] == ["night-1"]


@pytest.mark.deep
def test_a_job_that_repeats_says_which_application_has_changed_since(
    robomaker: Any, night: Any, service: Service, tmp_path: Path
) -> None:
    """It repeats with the archive that it ran with; of the archive of now nothing is said."""
    arn = night(choice="fast")
    (tmp_path / "other.tar.gz").write_bytes((tmp_path / "driver.tar.gz").read_bytes() + b"\0")
    service.store.put_file("applications", "driver.tar.gz", tmp_path / "other.tar.gz")

    ended = robomaker("flaky", "night-1", "--job", arn, "--reruns", "8")

    assert ended.code == 0
    assert "repeats bit by bit" in ended.out
    assert "The robot application has changed since the run; the reruns have the archive that it ran with." in ended.out


@pytest.mark.deep
def test_without_the_archive_of_the_run_reruns_would_say_nothing(
    robomaker: Any, night: Any, service: Service, tmp_path: Path
) -> None:
    arn = night(choice="unseeded")
    forget_archives(service)
    (tmp_path / "robot" / "more.py").write_text("")
    pack_tar_gz(tmp_path / "robot", tmp_path / "other.tar.gz")
    service.store.put_file("applications", "driver.tar.gz", tmp_path / "other.tar.gz")

    ended = robomaker("flaky", "night-1", "--job", arn)

    assert ended.code == 3
    assert "not run again: the robot application driver is not what it was" in ended.out
    assert ended.out.endswith("so that reruns would say nothing about the run\n")


@pytest.mark.deep
def test_an_error_is_no_verdict_on_the_robot(robomaker: Any, night: Any, home: Path) -> None:
    night(choice="crash")
    ended = robomaker("flaky", "night-1", "--reruns", "8", "-o", "json")
    [job] = json.loads(ended.out)["jobs"]
    assert (ended.code, job["answer"], job["verdict"]) == (0, "repeats", "RobotApplicationCrash")
    assert job["notes"] == [
        "The run ended with RobotApplicationCrash, which says nothing of how the robot did; it counts as an end here."
    ]
