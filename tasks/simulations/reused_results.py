"""Finding an earlier job with the same inputs, whose results a job can take over instead of running.

Only what would come out the same again is taken over: a job that ended by itself, with a verdict that its seed repeats,
and whose outputs the job's role may read now.
"""

from dataclasses import dataclass

from pydantic import ValidationError

from ...schemas.documents.reuse_inputs import REUSE_LABEL, ReuseInputs
from ...schemas.documents.simulation_jobs import MadeOf, ReusedFrom, SimulationJobDocument
from ...schemas.runs.plan import RunResult
from ...schemas.runs.provenance import PROVENANCE_FILE, Provenance
from ...schemas.wire.errors import StorageError
from ..catalog import Resource
from ..service.service import Service
from ..storage import read_manifest, removed_before
from .outputs.bounds import lacks_outputs
from .planning.job_contents import changed_import

_KIND = "simulation-job"
_RESULT_FILE = "result.json"
_LOOKED_AT = 10
"""How many jobs of the same inputs are looked at, the newest first."""
_CUT_SHORT = ("duration limit", "canceled")


@dataclass(frozen=True)
class FoundResults:
    """The earlier job whose results can be taken over, or why there is none."""

    job: Resource | None
    why_not: str = ""


def find_results(document: SimulationJobDocument, made_of: MadeOf, service: Service) -> FoundResults:
    """Finds an earlier job with the same inputs, the newest that ended well.

    Args:
        document: the job that is wanted.
        made_of: what its world and its applications are now.
        service: where jobs and outputs are stored.
    """
    if made_of.once_only:
        return FoundResults(None, made_of.once_only)
    try:
        acting = service.acting_as(document.request.get("iamRole"))
    except StorageError as error:
        return FoundResults(None, f"iamRole: {error}")
    key = ReuseInputs.of(document, made_of).key
    jobs = service.catalog.list(_KIND, filters={REUSE_LABEL: [key]}, limit=_LOOKED_AT).resources
    reasons = []
    for job in jobs:
        why_not = _why_not(job, key, acting)
        if why_not is None:
            return FoundResults(job)
        reasons.append(f"{job.id} {why_not}")
    return FoundResults(None, reasons[0] if reasons else "")


def with_results_of(document: SimulationJobDocument, job: Resource) -> SimulationJobDocument:
    """A job's document with the results of an earlier job."""
    earlier = SimulationJobDocument.of(job)
    return document.model_copy(
        update={
            "simulation_time_millis": earlier.simulation_time_millis,
            "verdict": earlier.verdict,
            "verdict_reason": earlier.verdict_reason,
            "finished": earlier.finished,
            "outputs": earlier.outputs,
            "made_of": earlier.made_of,
            "reused_from": earlier.reused_from or ReusedFrom(job=job.arn, spec_run=earlier.spec_run),
        }
    )


def _why_not(job: Resource, key: str, service: Service) -> str | None:
    """Why the results of a job of this key cannot be taken over; `None`: they can."""
    document = SimulationJobDocument.of(job)
    if document.made_of is None or ReuseInputs.of(document, document.made_of).key != key:
        return "was run with other inputs"
    if document.made_of.once_only:
        return f"has results that need not come again: {document.made_of.once_only}"
    if job.status != "Completed" or document.failure_code:
        return f"is {job.status}{f' ({document.failure_code})' if document.failure_code else ''}"
    return _why_not_outputs(document, service)


def _why_not_outputs(document: SimulationJobDocument, service: Service) -> str | None:
    """Why stored outputs cannot be taken over."""
    if (place := document.outputs) is None:
        return "has no outputs"
    try:
        manifest = read_manifest(service.store, place.bucket, place.prefix)
        if _RESULT_FILE not in {file.path for file in manifest.files}:
            return f"has no {_RESULT_FILE}"
        if lacks_outputs(manifest.about):
            return "has outputs of which a part was left out"
        if removed := removed_before(manifest)[0]:
            return f"has outputs of which {removed} files were removed to free space"
        stored = service.store.get_bytes(place.bucket, f"{place.prefix}/{_RESULT_FILE}")
        result = RunResult.model_validate_json(stored)
        stored = service.store.get_bytes(place.bucket, f"{place.prefix}/{PROVENANCE_FILE}")
        provenance = Provenance.model_validate_json(stored)
    except (StorageError, ValidationError) as error:
        return f"has outputs that cannot be read: {error}"
    if (changed := changed_import(provenance)) is not None:
        return f"imported another {changed} than there is now"
    if result.verdict == "ERROR":
        return "could not be judged (verdict ERROR)"
    return f"was ended by {result.ended_by}" if result.ended_by in _CUT_SHORT else None
