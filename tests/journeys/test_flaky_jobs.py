"""Jobs that are run again to see whether they repeat: what is not known of them is not claimed."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.flaky_causes import run_planted, upload
from helpers.paths import BUNDLES

from prefect_robomaker.schemas.reports.report import ReportedJob
from prefect_robomaker.schemas.runs.verification import Flakiness
from prefect_robomaker.tasks.flakiness.flaky_jobs import FEWEST_RERUNS, examine
from prefect_robomaker.tasks.flakiness.search import MOST_RERUNS
from prefect_robomaker.tasks.flakiness.trials import NotRerunError, Trials
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

pytestmark = pytest.mark.deep


def examined(arn: str, service: Service, most: int = FEWEST_RERUNS) -> Flakiness:
    jobs = [ReportedJob(label=arn, status="Completed", arn=arn)]
    return examine(jobs[0], jobs, service, most)


def ran(cause: Mapping[str, Any], service: Service) -> tuple[str, Mapping[str, str]]:
    """Runs a job; returns its ARN, and the place of its outputs."""
    [arn] = run_planted(cause, service, {})
    return arn, service.catalog.get(arn).document["outputs"]


def test_lost_commands_are_no_difference(service: Service, tmp_path: Path) -> None:
    upload(service, tmp_path)
    arn, place = ran({"choice": "fast"}, service)
    service.store.delete(place["bucket"], f"{place['prefix']}/actions.bin")
    found = examined(arn, service)
    assert (found.answer, found.verdict) == ("repeats", "PASS")
    assert "commands are not kept any more" in str(found)

    result = f"{place['prefix']}/result.json"
    text = service.store.get_bytes(place["bucket"], result).replace(b'"PASS"', b'"FAIL"')
    service.store.put_bytes(place["bucket"], result, text)
    found = examined(arn, service)
    assert (found.answer, found.verdict) == ("not decided", "FAIL")
    assert "all alike, and the run ended with FAIL" in str(found)


def test_equal_ends_of_a_job_without_states_are_not_the_same_bits(service: Service, tmp_path: Path) -> None:
    """The walkway kicks the robot at random, and not so far that it fails; nothing records that."""
    upload(service, tmp_path)
    walkway = shutil.copytree(BUNDLES / "flaky_walkway", tmp_path / "without-states")
    file = walkway / "walkway" / "__init__.py"
    file.write_text(file.read_text().replace("def state(", "def _state(").replace("0.9 *", "0.01 *"))
    pack_tar_gz(walkway, tmp_path / "walkway.tar.gz")
    service.store.put_file("applications", "walkway.tar.gz", tmp_path / "walkway.tar.gz")
    arn, _ = ran({"choice": "fast", "walkway": "entropy"}, service)
    found = examined(arn, service)
    assert (found.answer, found.has_states) == ("repeats", False)
    assert "bit by bit" not in str(found)


def test_a_simulation_that_kicks_at_random_is_the_side(service: Service, tmp_path: Path) -> None:
    """The robot's commands are the same each time; the walkway kicks it back in its tenth step, or not."""
    upload(service, tmp_path)
    arn, _ = ran({"choice": "fast", "walkway": "entropy"}, service)
    found = examined(arn, service, MOST_RERUNS)
    assert found.side == "simulation"
    assert found.reruns <= MOST_RERUNS
    assert found.decides in ("seed", None)
    assert (found.first_difference or "").startswith("at 0.50 s")


def test_what_decides_is_said_though_commands_cannot_be_replayed(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    upload(service, tmp_path)
    arn, _ = ran({"choice": "unseeded", "noise": "gauss"}, service)

    def replay(_self: Trials, _trial: object) -> None:
        raise NotRerunError("no room for it")

    monkeypatch.setattr(Trials, "replay", replay)
    found = examined(arn, service, MOST_RERUNS)
    assert (found.decides, found.side) == ("seed", "unknown")
    assert found.notes == ["The simulation could not be run again with recorded commands: no room for it."]


@pytest.mark.parametrize(("choice", "verdict"), [("fast", "PASS"), ("slow", "FAIL")])
def test_jobs_without_chance_repeat_bit_by_bit(service: Service, tmp_path: Path, choice: str, verdict: str) -> None:
    upload(service, tmp_path)
    arn, _ = ran({"choice": choice}, service)
    found = examined(arn, service)
    assert (found.answer, found.verdict) == ("repeats", verdict)
    assert "repeats bit by bit" in str(found)
