"""A run beside an earlier one whose process is killed: the process that finishes it decides, and stops it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.cartpole_spec import PACKAGE
from helpers.paths import REPOSITORY
from helpers.processes import kill_tree, started, wait_for

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.service.service import Service

ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
JOBS = 20
"""Eight pairs decide; on a busy machine a few more jobs end before the others are cancelled."""


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_a_killed_run_is_finished_against_the_same_run(
    service: Service, environ: dict[str, str], tmp_path: Path
) -> None:
    page = (REPOSITORY / "docs" / "comparison.md").read_text()
    [text] = [block for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if "\nsteps:" in block]
    (tmp_path / "poles.yaml").write_text(text.replace("seeds: 30", f"seeds: {JOBS}"))
    mine = {**environ, "PYTHONPATH": str(PACKAGE), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [*ROBOMAKER, "run", str(tmp_path / "poles.yaml")]
    # In a process of its own, which has ended: one that lives would finish the dead run before `perform` does.
    with started([*command, "--set", "gain=-1"], mine, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        said = run.communicate()
        assert run.returncode == 1, said
    [earlier] = service.catalog.list("simulation-job-batch").resources
    [first] = (service.settings.home / "runs").glob("*/run.json")

    def completed() -> int:
        batches = [each for each in service.catalog.list("simulation-job-batch").resources if each.arn != earlier.arn]
        counts = [service.catalog.count_children(each.arn, "simulation-job") for each in batches]
        return sum(each.get("Completed", 0) for each in counts)

    words = [*command, "--against", first.parent.name]
    with started(words, mine, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        wait_for(lambda: completed() >= 2, "two jobs to end")
        kill_tree(run.pid)
        [lock] = (service.settings.home / "runs").glob("*/running.lock")

    with started(
        [*ROBOMAKER, "perform", lock.parent.name], mine, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        said = run.communicate()
    record = RunRecord.model_validate_json((lock.parent / "run.json").read_text())
    assert (run.returncode, record.exit_code, record.state, len(record.interruptions)) == (0, 0, "succeeded", 1), said
    assert record.against is not None
    assert (record.against.answer, record.against.pairs, record.against.planned) == ("better", 8, JOBS)
    ran = sum(job.status == "Completed" for job in record.jobs)
    assert record.against.saved == JOBS - ran > 0
