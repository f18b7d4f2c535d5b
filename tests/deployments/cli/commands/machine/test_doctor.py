"""doctor and server, on this machine."""

import json
import re
import tomllib
import uuid
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night, store_night
from helpers.paths import REPOSITORY
from packaging.requirements import Requirement

from prefect_robomaker.deployments.cli import doctor_checks
from prefect_robomaker.deployments.cli.version_conflicts import CONFLICTS, Conflict, conflicts_among
from prefect_robomaker.schemas import extras
from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, Order, StepRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.nights.missed_nights import note_schedule
from prefect_robomaker.tasks.nights.open_runs import OpenRun


def test_a_healthy_machine(robomaker, home: Path) -> None:
    ended = robomaker("doctor", "-o", "json")
    document = json.loads(ended.out)
    healths = {finding["subject"]: finding["health"] for finding in document["findings"]}
    subjects = ["python", "packages", "physics", "data home", "catalog", "object store", "roles", "prefect server"]
    subjects += [
        "video",
        "extras",
        "containers",
        "sandbox",
        "left behind",
        "kept outputs",
        "kept archives",
        "left jobs",
        "broken-off runs",
    ]
    assert list(healths) == subjects
    assert "broken" not in healths.values(), ended.out
    assert ended.code == 0
    assert not list((home / "objects" / "robomaker").rglob(".doctor*/*")), "the probe is gone"


@pytest.mark.usefixtures("without_programs")
def test_a_wrong_roles_file_is_told_once_and_in_its_place(robomaker, monkeypatch, tmp_path: Path) -> None:
    roles = tmp_path / "roles.toml"
    roles.write_text('[[role]]\narn = "arn:aws:iam::000000000000:role/nightly"\nacces_key_id = "AK"\n')
    roles.chmod(0o600)
    monkeypatch.setenv("ROBOMAKER_ROLES_FILE", str(roles))

    ended = robomaker("doctor", "-o", "json")

    findings = json.loads(ended.out)["findings"]
    (broken,) = [finding for finding in findings if finding["health"] == "broken"]
    assert broken["subject"] == "roles"
    assert "did you mean 'access_key_id'?" in broken["found"]
    assert ended.code == 3


def test_what_is_broken_is_named_and_the_rest_is_checked(robomaker, monkeypatch, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("ROBOMAKER_HOME", str(blocked))
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:9/api")
    monkeypatch.setattr(doctor_checks, "check_physics", lambda: doctor_checks.Finding("physics", "ok", "not looked at"))
    monkeypatch.setattr(
        doctor_checks, "check_video", lambda: doctor_checks.Finding("video", "warning", "slow", "apt install x")
    )
    ended = robomaker("doctor")
    assert ended.code == 3
    assert "✗ data home" in ended.out
    assert "-> set ROBOMAKER_HOME to a folder you can write to" in ended.out
    assert "✗ object store" in ended.out
    assert "-> start that server, or unset PREFECT_API_URL" in ended.out
    assert "! video" in ended.out
    assert "-> apt install x" in ended.out
    assert "✓ physics" in ended.out


@pytest.mark.usefixtures("without_programs")
def test_a_disk_on_which_no_job_begins_is_broken(robomaker, monkeypatch) -> None:
    monkeypatch.setenv("ROBOMAKER_MIN_FREE_DISK_MB", "9999999")
    ended = robomaker("doctor")
    assert ended.code == 3
    assert "✗ data home" in ended.out
    assert "no job begins below ROBOMAKER_MIN_FREE_DISK_MB, which is 9999999" in ended.out


def test_a_check_that_raises_anything_is_a_finding(settings: Settings, monkeypatch) -> None:
    def raising(*_: object) -> doctor_checks.Finding:
        raise ImportError("libGL.so.1: cannot open shared object file")

    for name in ("check_physics", "check_video", "check_packages"):
        monkeypatch.setattr(doctor_checks, name, raising)
    findings = {finding.subject: finding for finding in doctor_checks.examine(settings)}
    assert findings["video"].health == "broken"
    assert "libGL.so.1" in findings["video"].found
    assert findings["data home"].health == "ok"


@pytest.mark.parametrize(("mode", "told"), [(0o700, "ok"), (0o770, "ok"), (0o755, "warning"), (0o707, "warning")])
def test_a_home_that_all_users_of_the_machine_may_look_into_is_told(tmp_path: Path, mode: int, told: str) -> None:
    tmp_path.chmod(mode)
    finding = doctor_checks.check_home(tmp_path)
    assert finding.health == told
    assert ("open to all users" in finding.found) == (told == "warning")
    assert f"{tmp_path}, 0 MB" in finding.found


def test_what_a_home_takes_up_is_said_by_its_largest_folders(tmp_path: Path) -> None:
    for name, size in (
        ("objects/a/b", 3_000_000),
        ("runs/1", 1_000_000),
        ("prefect/log", 2_000_000),
        ("jobs/x", 900_000),
    ):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_bytes(b"x" * size)
    (tmp_path / "runs" / "elsewhere").symlink_to("/usr")
    tmp_path.chmod(0o700)
    found = doctor_checks.check_home(tmp_path).found
    assert f"{tmp_path}, 7 MB (objects 3 MB, prefect 2 MB, runs 1 MB), " in found


def test_a_home_that_takes_long_to_measure_holds_doctor_up_no_longer(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(doctor_checks, "_LONGEST_WALK_S", 0.0)
    (tmp_path / "objects").mkdir()
    assert "at least 0 MB" in doctor_checks.check_home(tmp_path).found


def test_a_home_that_is_a_file_is_a_finding(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "file")})
    findings = {finding.subject: finding for finding in doctor_checks.examine(settings)}
    assert findings["data home"].health == "broken"
    assert str(tmp_path / "file") in findings["data home"].found
    assert "nights" not in findings


def test_wrong_package_versions_are_found(monkeypatch) -> None:
    monkeypatch.setattr("importlib.metadata.requires", lambda _: ["mujoco>=900", "no-such-package-anywhere", "numpy>1"])
    finding = doctor_checks.check_packages()
    assert finding.health == "broken"
    assert "mujoco is" in finding.found
    assert "not >=900" in finding.found
    assert "no-such-package-anywhere is missing" in finding.found
    assert "numpy" not in finding.found


def test_versions_that_do_not_work_together_are_told_with_what_users_see_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in an environment of one's own, where pip put another SQLAlchemy beside the wheel."""
    other = tmp_path / "sqlalchemy-2.1.9.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: SQLAlchemy\nVersion: 2.1.9\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    finding = doctor_checks.check_packages()

    assert finding.health == "broken"
    assert (
        "with sqlalchemy 2.1.9: the server's scheduler fails at each look, and no schedule ever fires" in finding.found
    )
    assert "pip install 'sqlalchemy>=2.0.40,<2.1'" in finding.remedy


@pytest.mark.parametrize("conflict", CONFLICTS, ids=lambda conflict: conflict.second)
def test_conflicts_are_kept_apart_by_the_bounds_of_this_package(conflict: Conflict) -> None:
    """A remedy is the bound that `pyproject.toml` has, and versions within it are no conflict."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert conflict.remedy in project["dependencies"]

    first, second, remedy = (Requirement(text) for text in (conflict.first, conflict.second, conflict.remedy))
    lowest = {each.name: min(clause.version for clause in each.specifier) for each in (first, second)}
    (found,) = conflicts_among(lowest.get)
    assert found.text.startswith(f"{first.name} {lowest[first.name]} with {second.name} {lowest[second.name]}: ")
    assert not remedy.specifier.contains(lowest[second.name])
    assert list(conflicts_among({first.name: lowest[first.name]}.get)) == []


@pytest.mark.parametrize("action", ["status", "stop"])
def test_no_server_is_said_to_run_before_one_is_started(robomaker, monkeypatch, tmp_path: Path, action: str) -> None:
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    ended = robomaker("server", action)
    assert "running" in ended.out
    assert ended.code == (3 if action == "status" else 0)


def test_what_only_some_jobs_need_is_told_and_is_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    none = doctor_checks.check_extras()
    assert none.health == "ok"
    assert "docker is not installed; podman is not installed" in none.found
    assert "missing: ROS launch files: neither roslaunch nor ros2 is on the path" in none.found
    assert re.search(r"^there: .*extras .*ros \(bridge to ROS 2 by cyclonedds\)", none.found, re.MULTILINE)

    for name in ("podman", "ros2"):
        (tmp_path / name).write_text("#!/bin/sh\necho 5.0\n")
        (tmp_path / name).chmod(0o755)
    some = doctor_checks.check_extras()
    assert f"container images by {tmp_path / 'podman'}" in some.found
    assert re.search(r"^there: .*ROS launch files by ros2", some.found, re.MULTILINE)
    monkeypatch.setattr(extras, "_is_installed", lambda package: package != "cyclonedds")
    lacking = doctor_checks.check_extras().found
    how = extras.how_to_install("ros")
    assert f"missing: extras ros (bridge to ROS 2 by cyclonedds); the first is added by: {how}" in lacking


@pytest.mark.deep
@pytest.mark.slow
@pytest.mark.usefixtures("without_programs")
def test_a_backend_is_tried_with_one_job(robomaker: Any, prefect_server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PREFECT_API_URL", prefect_server)

    examined = robomaker("doctor", "--backend", "local")
    again = robomaker("doctor", "--backend", "local")  # its applications are there already

    for each in (examined, again):
        assert re.search(r"✓ backend local +one job ran there", each.out), each.out + each.err


def test_a_backend_that_there_is_not_is_refused_before_anything_is_looked_at(robomaker: Any) -> None:
    refused = robomaker("doctor", "--backend", "slurm:somewhere")

    assert refused.code == 2
    assert "slurm:somewhere" in refused.err
    assert "dask" in refused.err


def test_scheduled_runs_that_broke_before_their_jobs_are_named(settings: Settings) -> None:
    now = datetime.now(UTC)
    note_schedule(settings.home, str(uuid.uuid4()), "nightly", now)
    refused = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error="no such robot")
    failed = StepRecord(name="robot", operation="CreateRobotApplication", status="Failed", error="no archive")
    for night, steps in enumerate(([refused], [failed])):
        record = make_night("", night, runs=settings.home / "runs")
        store_night(record.model_copy(update={"state": "broken", "steps": steps, "started_at": now}))

    found = doctor_checks.broken_nights(settings, now - timedelta(days=7))

    moment = f"on {now.day} {now:%B} ({now:%H:%M} UTC)"
    assert sorted(found) == [
        f"nightly: broken {moment}: step robot: no archive", f"nightly: refused {moment}: no such robot"
    ]  # fmt: skip


def test_a_run_whose_process_died_is_named_with_what_finishes_it(settings: Settings) -> None:
    folder = settings.home / "runs" / "night-20261127T020000000"
    folder.mkdir(parents=True)
    order = Order(run_id=folder.name, text="", filename="", spec_path="", command=["true"])
    OpenRun.begin(folder, order).pass_on()  # as when its process dies
    finding = doctor_checks.check_broken_off(settings)
    assert finding.health == "warning"
    assert f"{folder.name}: a Python program" in finding.found
    assert finding.remedy == "start robomaker serve or a Prefect worker, which finishes them"

    finding = doctor_checks.check_broken_off(settings.model_copy(update={"finish_within_hours": 0}))
    assert finding.remedy == f"robomaker perform {folder.name}"
