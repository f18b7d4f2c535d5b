"""Outputs of jobs as reports and the table of results show them: files, results, pictures, trials."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.reports.report import ReportedFile, ReportedJob
from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.plan import RunResult
from ...schemas.runs.trial_rows import TRIALS_FILE
from ...schemas.wire.errors import ObjectNotFoundError, StorageError
from ..comparison.nights import TRIALS
from ..results.columns import read_trials
from ..results.table import RESULTS_FILE, ResultTable
from ..service.service import Service
from ..storage import read_manifest, removed_before

if TYPE_CHECKING:
    import pyarrow as pa


def outputs_of(place: StoredPlace | None, service: Service) -> tuple[list[ReportedFile], RunResult | None, bytes, int]:
    """Files, result and poster of a run, and how many files were removed; nothing of outputs that cannot be read."""
    if place is None:
        return [], None, b"", 0
    bucket, prefix = place.bucket, place.prefix
    try:
        manifest = read_manifest(service.store, bucket, prefix)
        entries = manifest.files
        names = {entry.path for entry in entries}
        result = service.store.get_bytes(bucket, f"{prefix}/result.json") if "result.json" in names else None
        poster = service.store.get_bytes(bucket, f"{prefix}/poster.png") if "poster.png" in names else b""
        parsed = RunResult.model_validate_json(result) if result else None
    except ObjectNotFoundError:
        return _unfinished(bucket, prefix, service), None, b"", 0
    except (StorageError, ValidationError):
        return [], None, b"", 0
    files = [
        ReportedFile(
            name=entry.path, uri=service.store.uri(bucket, f"{prefix}/{entry.path}"), size_bytes=entry.size_bytes
        )
        for entry in entries
    ]
    return files, parsed, poster, removed_before(manifest)[0]


def _unfinished(bucket: str, prefix: str, service: Service) -> list[ReportedFile]:
    """The files that a crashed or killed run left: no manifest names them, and its logs say why."""
    try:
        return [
            ReportedFile(
                name=item.key.removeprefix(f"{prefix}/"),
                uri=service.store.uri(bucket, item.key),
                size_bytes=item.size_bytes,
            )
            for item in service.store.list(bucket, f"{prefix}/")
        ]
    except StorageError:
        return []


def judged_without_outputs(document: SimulationJobDocument) -> RunResult:
    """The catalog's verdict of a result whose file cannot be read: a run that failed stays one."""
    took_s = (document.simulation_time_millis or 0) / 1000
    return RunResult(
        verdict=document.verdict or "NONE",
        summary=document.verdict_reason or "",
        notes=["result.json cannot be read: only the verdict is known"],
        sim_time_s=0.0,
        wall_time_s=took_s,
        real_time_factor=0.0,
        ended_by="",
        seed=document.seed,
    )


def places_of(jobs: Sequence[ReportedJob], service: Service) -> dict[str, StoredPlace]:
    """Returns the places of the jobs' outputs, by ARN."""
    stored = service.catalog.get_many(job.arn for job in jobs if job.arn)
    found = {arn: SimulationJobDocument.of(resource).outputs for arn, resource in stored.items()}
    return {arn: place for arn, place in found.items() if place is not None}


def write_results(
    jobs: Sequence[JobRecord], places: Mapping[str, StoredPlace], service: Service, folder: Path
) -> ResultTable:
    """Writes the table of results of a run, with the trials of its jobs; one that has more than is stored now stays."""
    lost = False

    def trials_of(job: JobRecord) -> "pa.Table | None":
        nonlocal lost
        found = _trials_of(job, places, service)
        lost = lost or job.status == "Deleted" or (found is None and _has_trials(job))
        return found

    results = ResultTable.of(jobs, trials_of)
    if lost:
        with suppress(OSError, ValueError):
            return ResultTable.read(folder / RESULTS_FILE)
    folder.mkdir(parents=True, exist_ok=True)
    results.write(folder / RESULTS_FILE)
    return results


def _has_trials(job: JobRecord) -> bool:
    return any(item.name == TRIALS for item in job.requirements)


def _trials_of(job: JobRecord, places: Mapping[str, StoredPlace], service: Service) -> "pa.Table | None":
    """The table of a job's trials; None: it has none, or it is not stored any more."""
    place = places.get(job.arn or "")
    if place is None or not _has_trials(job):
        return None
    try:
        return read_trials(service.store.get_bytes(place.bucket, f"{place.prefix}/{TRIALS_FILE}"))
    except (StorageError, ValueError):
        return None
