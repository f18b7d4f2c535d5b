"""The page about backups, typed: what was copied is whole in another home, and jobs that ran meanwhile end there."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night, store_night
from helpers.paths import REPOSITORY
from helpers.postgres_server import NEEDS_POSTGRESQL, PROGRAMS, PostgresServer

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.consistency.checking import check_consistency
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

PAGE = (REPOSITORY / "docs" / "backup.md").read_text()
BLOCKS = re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def shell(script: str, home: Path, backup: Path, **variables: str) -> str:
    """Runs a block of the page; returns what it printed."""
    environ = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "HOME": str(home.parent)}
    environ |= {"ROBOMAKER_HOME": str(home), "BACKUP": str(backup)} | variables
    done = subprocess.run(["sh", "-eu", "-c", script], env=environ, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def running(service: Service, order: Callable[..., dict[str, Any]]) -> str:
    """A job that is being performed when the backup is made, as its catalog says."""
    arn = call("CreateSimulationJob", order(), service)["arn"]
    service.catalog.transition(arn, "prepare", document_changes={"runId": "2026-01-02T03-04-05-000000Z"})
    service.catalog.transition(arn, "start")
    return arn


@pytest.mark.deep
@pytest.mark.slow
@pytest.mark.usefixtures("known_worlds")
def test_what_was_copied_is_whole_in_another_home(
    service: Service,
    generate: Callable[..., dict[str, Any]],
    simulate: Callable[..., dict[str, Any]],
    order: Callable[..., dict[str, Any]],
    running: str,
    tmp_path: Path,
) -> None:
    [world] = generate()["finishedWorldsSummary"]["succeededWorlds"]
    job = simulate(order())["arn"]
    home, backup = service.settings.home, tmp_path / "backup"
    back_up, restore, _ = BLOCKS

    shell(back_up, home, backup)
    assert backup.stat().st_mode & 0o077 == 0, "it has the keys of robots"
    later = simulate(order())["arn"]
    shutil.rmtree(home)
    told = shell(restore, tmp_path / "restored", backup)

    assert told.splitlines()[-1] == "Catalog and object store agree."
    restored = Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "restored")}), {})
    arns = {each.arn for kind in ("world", "simulation-job") for each in restored.catalog.list(kind).resources}
    assert arns == {world, job, running}
    assert later not in arns
    assert registry()["CreateSimulationJob"].perform(running, restored)["status"] == "Completed"


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
def test_a_moved_home_goes_on_at_its_new_place_and_leaves_nothing_at_the_old_one(
    service: Service, simulate: Callable[..., dict[str, Any]], order: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    simulate(order())
    home, moved = service.settings.home, tmp_path / "moved"
    folder = store_night(make_night("PF", runs=home / "runs"))

    told = shell(BLOCKS[2], home, tmp_path / "backup", NEW_HOME=str(moved))
    report = shell(f"robomaker report {folder.name}", moved, tmp_path / "backup")

    assert told.splitlines()[-1] == "Catalog and object store agree."
    assert str(moved / "runs" / folder.name / "report.html") in report
    assert not home.exists()


@NEEDS_POSTGRESQL
@pytest.mark.deep
def test_a_dump_of_postgresql_restores_the_catalog(
    settings: Settings,
    postgres_server: PostgresServer,
    postgres_database: str,
    order: Callable[..., dict[str, Any]],
    service: Service,
    prefect_server: str,
    tmp_path: Path,
) -> None:
    assert PROGRAMS is not None
    on_postgres = Service.open(settings.model_copy(update={"catalog_url": postgres_database}), {})
    request = order()
    for kind, name in (("robot-application", "watcher"), ("simulation-application", "sleeper")):
        application = service.catalog.find(kind, name)
        assert application is not None
        on_postgres.catalog.create(application, token=None)
    arn = call("CreateSimulationJob", request, on_postgres)["arn"]
    assert registry()["CreateSimulationJob"].perform(arn, on_postgres)["status"] == "Completed"
    on_postgres.catalog.close()
    dump = tmp_path / "catalog.dump"

    with postgres_server.new_database() as restored:
        for program, options, url in (
            ("pg_dump", ["--format=custom", f"--file={dump}"], postgres_database),
            ("pg_restore", [str(dump), "--dbname"], restored),
        ):
            plain = url.replace("postgresql+psycopg", "postgresql")
            subprocess.run([PROGRAMS / program, *options, plain], check=True, capture_output=True)
        after = Service.open(settings.model_copy(update={"catalog_url": restored}), {})

        assert call("DescribeSimulationJob", {"job": arn}, after)["status"] == "Completed"
        report = check_consistency(after, read_content=True)
        assert (report.findings, report.resources) == ([], 1)
        after.catalog.close()
