"""Records of runs that never were: nights of a specification with the verdicts, metrics and inputs a test wants."""

import hashlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow as pa

from prefect_robomaker.schemas.reports.run_exit_codes import EXIT_CODES
from prefect_robomaker.schemas.reports.run_record import JobInputs, JobRecord, RunRecord, SourceCommit, UsedApplication
from prefect_robomaker.schemas.runs.plan import Requirement, Verdict
from prefect_robomaker.schemas.runs.trial_rows import TrialRow
from prefect_robomaker.tasks.inspection.run_records import write_record
from prefect_robomaker.tasks.results.columns import Names, columns_of, schema_of
from prefect_robomaker.tasks.results.table import RESULTS_FILE, ResultTable

FIRST_NIGHT = datetime(2026, 3, 1, 2, tzinfo=UTC)
VERDICTS: dict[str, dict[str, Any]] = {
    "P": {"status": "Completed", "verdict": "PASS"},
    "F": {"status": "Completed", "verdict": "FAIL"},
    "E": {"status": "Failed", "failure_code": "RobotApplicationCrash", "failure_reason": "ZeroDivisionError\nlog"},
    "C": {"status": "Canceled"},
    "N": {"status": "Completed", "verdict": "NONE"},
}
"""What a letter of a night means: passed, failed, broken, canceled, no verdict."""


def digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def make_job(
    index: int,
    letter: str,
    *,
    night: int = 0,
    robot: str = "robot 1",
    request: str | None = None,
    world: str | None = "",
    seed: int | None = 7,
    metrics: Mapping[str, float] | None = None,
    limit: float = 5.0,
    trials: str | None = None,
) -> JobRecord:
    """A job; `world` None: without one, empty: one of its own."""
    content = None if world is None else digest(world or f"world {index}")
    passed = letter == "P"
    requirements = [
        Requirement(
            name="gentle", kind="no_collision", satisfied=passed, detail="9 N, at most 5 N asked", value=9.0,
            limit=limit, unit="N", margin=limit - 9.0,
        )
    ]  # fmt: skip
    return JobRecord(
        label=f"sim-{night}-{index}",
        arn=f"arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-{night}-{index}",
        world=None if world is None else f"generation-{night}/world-{index + 1}",
        step="drive",
        test=f"request {index + 1} scout" if world is None else f"world-{index + 1} scout",
        inputs=JobInputs(
            seed=seed if seed is not None else night * 1000 + index,
            seed_given=seed is not None,
            world=content,
            applications=[UsedApplication(role="robot", name="scout", digest=digest(robot))],
            requirements_sha256=digest(f"limit {limit}"),
            request_sha256=digest(request or "request"),
            trials_and_data_sha256=digest(trials) if trials else None,
        ),
        requirements=requirements if letter in "PF" else [],
        metrics=dict(metrics or {}) if letter in "PFN" else {},
        **VERDICTS[letter],
    )


def make_night(
    verdicts: str | Sequence[JobRecord],
    night: int = 0,
    *,
    name: str = "nightly",
    runs: Path = Path("/nowhere"),
    commit: str | None = "a",
    **job: Any,
) -> RunRecord:
    """A run: one job for each letter, or the jobs given, a day after the night before."""
    started_at = FIRST_NIGHT + timedelta(days=night)
    run_id = f"{name}-{started_at:%Y%m%dT%H%M%S}000"
    jobs = [
        make_job(index, each, night=night, **job) if isinstance(each, str) else each
        for index, each in enumerate(verdicts)
    ]
    state = "broken" if "E" in verdicts else "failed" if "F" in verdicts else "succeeded"
    return RunRecord(
        run_id=run_id,
        name=name,
        spec_path=f"{name}.yaml",
        state=state,
        exit_code=EXIT_CODES[state],
        started_at=started_at,
        ended_at=started_at + timedelta(minutes=9),
        steps=[],
        jobs=jobs,
        versions={"prefect-robomaker": "0.1.0"},
        source=SourceCommit(commit=digest(commit)[:40], changed=False) if commit else None,
        report_path=runs / run_id / "report.html",
        run_dir=runs / run_id,
    )


def store_night(record: RunRecord) -> Path:
    """Writes a record where `robomaker` finds it."""
    record.run_dir.mkdir(parents=True)
    write_record(record)
    return record.run_dir


_OF_TRIALS: Mapping[str, Verdict] = {"P": "PASS", "F": "FAIL", "E": "ERROR", "N": "NONE"}


def trials_of(letters: str, *, axes: Mapping[str, str] | None = None, states: str = "") -> pa.Table:
    """The table of a job's trials, one a letter, with seeds from 100; `states` has a letter for the states of each."""
    rows = [
        TrialRow(
            trial=number,
            seed=100 + number,
            axes=dict(axes or {}),
            verdict=_OF_TRIALS[letter],
            requirements=make_job(0, letter).requirements,
            metrics={"distance_m": float(number)} if letter in "PF" else {},
            state_digest=digest(states[number]) if states else None,
        )
        for number, letter in enumerate(letters)
    ]
    names = Names.of(rows)
    return pa.Table.from_pylist(
        [columns_of(row, names) for row in rows], schema_of(dict.fromkeys(axes or (), False), names)
    )


def make_trials_night(
    trials: Sequence[str],
    night: int = 0,
    *,
    runs: Path,
    worlds: Sequence[str | None] | None = None,
    states: str = "",
    **more: Any,
) -> RunRecord:
    """A stored run of jobs with trials: a text of letters for each job, and its world (else one of its own each)."""
    jobs = []
    for index, letters in enumerate(trials):
        verdict = "E" if "E" in letters else "F" if "F" in letters else "P"
        job = make_job(index, "F" if verdict == "E" else verdict, night=night, world=worlds[index] if worlds else "")
        own = Requirement(name="trials", satisfied=verdict == "P", detail=letters)
        jobs.append(job.model_copy(update={"requirements": [own]}))
    record = make_night(jobs, night, runs=runs, **more)
    folder = store_night(record)
    tables = {job.label: trials_of(letters, states=states) for job, letters in zip(jobs, trials, strict=True)}
    ResultTable.of(jobs, lambda job: tables[job.label]).write(folder / RESULTS_FILE)
    return record
