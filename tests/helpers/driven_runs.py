"""Jobs that drove in a stored world, as they are after they ran: paths, requirements, videos; two runs of them."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from helpers.night_records import make_job, make_night, store_night
from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.documents.worlds import StoredPlace, WorldDocument
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord
from prefect_robomaker.schemas.runs.plan import Requirement, RunResult
from prefect_robomaker.schemas.runs.trial_rows import trial_folder
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.runtime.episode.run_timeline import FilmTimes, RunTimeline, write_timeline
from prefect_robomaker.tasks.runtime.video.video import VideoWriter
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import publish

GOAL = {"kind": "goal", "name": "there", "x": 1.4, "y": 0.3, "within_m": 0.3}
_RATE_HZ = 10


def content_of(world: str, service: Service) -> str:
    """The digest of a stored world's content."""
    bundle = WorldDocument.of(service.catalog.get(world, kind="world")).bundle
    assert bundle is not None
    return bundle.last_part


def path_of(end_s: float, sway_m: float) -> list[tuple[float, float, float]]:
    """A drive to the east that sways to both sides: simulated time in seconds, x and y in metres."""
    return [
        (step * end_s / 40, step * 1.5 / 40, sway_m * math.sin(step * math.pi / 20)) for step in range(41)
    ]  # fmt: skip


def drive(
    service: Service,
    folder: Path,
    letter: str,
    *,
    world: str | None,
    night: int,
    index: int = 0,
    end_s: float = 4.0,
    sway_m: float = 0.2,
    margin: float = 2.0,
    video: str = "",
    begins_s: float | None = 0.0,
    states: str | None = None,
    trials: Mapping[int, float] | None = None,
    **job: Any,
) -> JobRecord:
    """Stores a job that has ended, and returns its record.

    Args:
        service: Stores it.
        folder: A folder for its outputs on their way.
        letter: How it ended, as in `helpers.night_records`; `E`: it left nothing.
        world: ARN of its world.
        night: Number of its run.
        index: Its number in that.
        end_s: Simulated time at its end.
        sway_m: How far it sways.
        margin: Margin of its requirement `gentle` in newtons; below 0 it is missed at half of the time.
        video: Name of its video; empty: none.
        begins_s: Simulated time at which the video begins, in seconds; None: it is not recorded.
        states: Digest of all states that it went through.
        trials: Margins of `gentle` by numbers of recorded trials, of three; None: the job has none.
        **job: Further members of `helpers.night_records.make_job`.
    """
    record = make_job(index, letter, night=night, world=world, **job)
    assert record.inputs is not None
    inputs = record.inputs.model_copy(update={"world": content_of(world, service) if world else None})
    gentle = _gentle(margin, end_s)
    there = Requirement(name="there", kind="goal", satisfied=True, detail="reached", margin=1.0, unit="s")
    result = RunResult(
        verdict=record.verdict or "NONE", requirements=[there, gentle], path=path_of(end_s, sway_m), sim_time_s=end_s,
        wall_time_s=1.0, real_time_factor=end_s, ended_by="agent", seed=7,
        state_digest=states,
    )  # fmt: skip
    own = [there, gentle] if trials is None else [Requirement(name="trials", satisfied=letter == "P", detail="")]
    if trials is not None:
        result = result.model_copy(update={"path": [], "extra": {"trials": _summary_of(trials)}})
    each = {
        trial: result.model_copy(
            update={
                "path": path_of(end_s, 0.1 * trial), "requirements": [_gentle(least, end_s)], "extra": {},
                "verdict": "PASS" if least >= 0 else "FAIL",
            }
        )
        for trial, least in (trials or {}).items()
    }  # fmt: skip
    outputs = folder / f"outputs-{night}-{index}-{letter}-{world is None}"
    place = _publish(service, outputs, result, video, begins_s, each)
    config = {"application": "indoor-navigation", **({"worldConfigs": [{"world": world}]} if world else {})}
    document = SimulationJobDocument(
        request={"simulationApplications": [config], "requirements": [GOAL], "video": "on-failure"},
        seed=7,
        outputs=None if letter == "E" else place,
    )
    stored = service.store_job(
        "simulation-job", "sim", document, tags=None, token=None, status="Failed" if letter == "E" else "Completed"
    )
    is_judged = letter in "PF"
    return record.model_copy(
        update={
            "arn": stored.arn,
            "label": stored.id,
            "inputs": inputs,
            "requirements": own if is_judged else [],
        }
    )


def two_runs(service: Service, before: Sequence[JobRecord], after: Sequence[JobRecord], **more: Any) -> list[RunRecord]:
    """Stores two runs of jobs, and returns their records; `more` are members of the second one."""
    runs = service.settings.home / "runs"
    records = [make_night(list(jobs), night, runs=runs) for night, jobs in enumerate((before, after))]
    records[1] = records[1].model_copy(update=more)
    for record in records:
        store_night(record)
    return records


def _gentle(margin: float, end_s: float) -> Requirement:
    return Requirement(
        name="gentle", kind="no_collision", satisfied=margin >= 0, detail=f"{5 - margin:g} N, at most 5 N asked",
        value=5 - margin, limit=5.0, unit="N", margin=margin, first_violation_s=None if margin >= 0 else end_s / 2,
        other=None if margin >= 0 else "wall",
    )  # fmt: skip


def _summary_of(trials: Mapping[int, float]) -> dict[str, Any]:
    failing = [
        {"trial": trial, "seed": trial, "verdict": "FAIL", "reason": f"gentle: {5 - margin:g} N", "recorded": True}
        for trial, margin in trials.items()
        if margin < 0
    ]
    counts = {"passed": 3 - len(failing), "failed": len(failing)}
    return {"planned": 3, "counts": counts, "failing": failing, "recorded": sorted(trials)}


def _publish(
    service: Service,
    folder: Path,
    result: RunResult,
    video: str,
    begins_s: float | None,
    trials: Mapping[int, RunResult],
) -> StoredPlace:
    _write(folder, result, video if not trials else "", begins_s)
    for trial, own in trials.items():
        _write(folder / trial_folder(trial), own, video, begins_s)
    service.store.ensure_bucket("out")
    publish(service.store, "out", folder.name, regular_files(folder), about={}, created_at=service.clock())
    return StoredPlace(bucket="out", prefix=folder.name)


def _write(folder: Path, result: RunResult, video: str, begins_s: float | None) -> None:
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(result.model_dump_json())
    if video:
        writer = VideoWriter(folder / video, (160, 120), _RATE_HZ)
        for frame in range(round(result.sim_time_s * _RATE_HZ) + 1):
            picture = np.full((120, 160, 3), 40, np.uint8)
            picture[:, : 2 + frame * 150 // round(result.sim_time_s * _RATE_HZ)] = (220, 160, 60)
            writer.add(picture)
        writer.close()
        frames = round(result.sim_time_s * _RATE_HZ) + 1
        times = {} if begins_s is None else {video: FilmTimes(begins_s=begins_s, rate_hz=_RATE_HZ, frames=frames)}
        write_timeline(RunTimeline(videos=times), folder)
