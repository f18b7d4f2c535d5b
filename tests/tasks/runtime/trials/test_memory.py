"""The memory that many trials take."""

from pathlib import Path

import pytest
from helpers.paths import BUNDLES
from helpers.processes import working_below

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.trials.completion import journal_path

COUNT = 1500
MOST_MB, GROWTH_MB = 400, 20


def resident_mb(pid: int) -> float | None:
    """What a process holds; None of one that has just ended, of which the system knows no memory any more."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return None
    found = [int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmRSS")]
    return found[0] if found else None


@pytest.mark.deep
def test_a_thousand_more_trials_take_no_more_memory(launcher: Launcher, tmp_path: Path) -> None:
    bundle = BUNDLES / "swinger"
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=600.0, record=False,
        work_dir=tmp_path / "work", output_dir=tmp_path / "out", trials=Trials(seeds=COUNT),
        simulation_application=ApplicationPlan(
            role="simulation", name="swing", attribute="swinger.make_environment", path=bundle,
            environment_variables={"TIME_LIMIT_S": "0.1"},
        ),
        robot_application=ApplicationPlan(role="robot", name="pusher", attribute="swinger.make_agent", path=bundle),
    )  # fmt: skip
    seen: list[tuple[int, float]] = []

    def look() -> None:
        journal = journal_path(plan)
        if journal.exists() and (found := working_below(tmp_path)):
            rows = journal.read_bytes().count(b"\n")
            if (resident := resident_mb(found.pop())) is not None:
                seen.append((rows, resident))

    assert launcher.run(plan, look).status == "Completed"

    early = max(resident for rows, resident in seen if rows <= 500)
    late = max(resident for rows, resident in seen if 500 < rows < COUNT)
    assert late < early + GROWTH_MB
    assert max(resident for _, resident in seen) < MOST_MB
