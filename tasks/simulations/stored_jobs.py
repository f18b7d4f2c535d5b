"""Simulation jobs in the catalog: stores new ones, or ones that reuse the results of an earlier job."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.documents.reuse_inputs import REUSE_LABEL, ReuseInputs
from ...schemas.documents.simulation_jobs import MadeOf, ReusedFrom, SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.operations.registry import seed_of, video_of
from ...schemas.operations.simulation_jobs import SimulationJobRequestMembers
from ...schemas.reports.names import name_label
from ...schemas.runs.plan import ApplicationRole, RunResult
from ...schemas.runs.policies import policy_in
from ...schemas.runs.provenance import PROVENANCE_FILE, Manifest, Provenance
from ...schemas.runs.requirements import requirements_of
from ...schemas.runs.trials import trials_of
from ...schemas.wire.common import counted
from ...schemas.wire.errors import InvalidParameterException, StorageError
from ..catalog import ClientToken, Resource
from ..service.references import name_of_job, name_of_world
from ..service.service import Service, is_builtin
from ..storage import read_manifest, removed_before
from ..storage.object_store import join_key
from .inputs.bundles import check_rooms
from .inputs.data_sources import resolve_data_sources
from .outputs.output_places import check_output_location
from .outputs.storable_files import lacks_outputs
from .planning.application_plans import image_of
from .planning.job_contents import CurrentApplications, changed_import, contents_of_request
from .planning.run_plans import world_arn

_KIND = "simulation-job"
_RESULT_FILE = "result.json"
_LOOKED_AT = 10
"""Maximum number of jobs with the same inputs that are examined, newest first."""
_CUT_SHORT = ("duration limit", "canceled")


@dataclass(frozen=True)
class FoundResults:
    """The earlier job whose results can be reused, or the reason why there is none."""

    job: Resource | None
    why_not: str = ""


def find_results(document: SimulationJobDocument, made_of: MadeOf, service: Service) -> FoundResults:
    """Returns the newest successful job with the same inputs, whose results can be reused, or why there is none.

    Args:
        document: Document of the new job.
        made_of: Present contents of its world and applications.
        service: The service, with its catalog and object store.
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
    """Returns a copy of a job's document that has the results of an earlier job, and names the job that made them."""
    earlier = SimulationJobDocument.of(job)
    return document.model_copy(
        update={
            "simulation_time_millis": earlier.simulation_time_millis,
            "verdict": earlier.verdict,
            "verdict_reason": earlier.verdict_reason,
            "judged": earlier.judged,
            "finished": earlier.finished,
            "outputs": earlier.outputs,
            "made_of": earlier.made_of,
            "reused_from": earlier.reused_from or ReusedFrom(job=job.arn, spec_run=earlier.spec_run),
        }
    )


def _why_not(job: Resource, key: str, service: Service) -> str | None:
    """Returns the reason why an earlier job's results cannot be reused for a key of inputs; `None` if they can."""
    document = SimulationJobDocument.of(job)
    if document.made_of is None or ReuseInputs.of(document, document.made_of).key != key:
        return "was run with other inputs"
    if document.made_of.once_only:
        return f"has results that need not come again: {document.made_of.once_only}"
    if job.status != "Completed" or document.failure_code:
        return f"is {job.status}{f' ({document.failure_code})' if document.failure_code else ''}"
    return _why_not_outputs(document, service)


def _why_not_outputs(document: SimulationJobDocument, service: Service) -> str | None:
    """Returns the reason why a job's stored outputs cannot be reused, such as missing files; `None` if they can."""
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
        if gone := _gone_files(manifest, place, service):
            more = f" and {counted(len(gone) - 1, 'other file')} are" if gone[1:] else " is"
            return f"has outputs of which {gone[0]}{more} gone from the object store"
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


def _gone_files(manifest: Manifest, place: StoredPlace, service: Service) -> list[str]:
    """Returns the paths of published files that are not stored any more, or were stored only in part."""
    prefix = join_key(place.prefix, "")
    there = {file.key.removeprefix(prefix): file.size_bytes for file in service.store.list(place.bucket, prefix)}
    return [file.path for file in manifest.files if there.get(file.path) != file.size_bytes]


KIND = "simulation-job"
_ROLES: tuple[ApplicationRole, ...] = ("robot", "simulation")


def store_job(
    request: SimulationJobRequestMembers,
    service: Service,
    *,
    token: ClientToken | None,
    batch: tuple[str, int] | None = None,
) -> Resource:
    """Stores a simulation job with status Pending, and returns it, or the one that the client token has stored before.

    Args:
        request: Request of a single job, or of one in a batch.
        service: The service, with its catalog and object store.
        token: Client token, which makes the call idempotent.
        batch: ARN of the job's batch, and the index of its request in the batch.

    Raises:
        ResourceNotFoundException: An application or world does not exist.
        InvalidParameterException: Data cannot be read, an application cannot be started so, or the world has no such
            room.
        IdempotentParameterMismatchException: The token was used for another request.
    """
    if (earlier := service.find_by_client_token(token)) is not None:
        return earlier
    return _store(job_document(request, service, batch), "Pending", request, service, token, batch)


def reuse_job(
    request: SimulationJobRequestMembers,
    service: Service,
    *,
    token: ClientToken | None,
    batch: tuple[str, int] | None = None,
    applications: CurrentApplications | None = None,
) -> Resource | None:
    """Stores a simulation job as completed, with the results of an earlier job with the same inputs.

    Args:
        request: Request of a single job, or of one in a batch.
        service: Service with its catalog and object store.
        token: Client token, which makes the call idempotent.
        batch: ARN and index of the batch; see `store_job`.
        applications: Source of applications; absent: the catalog.

    Returns:
        The job; `None`: no earlier job has results to reuse, or each job draws a seed of its own.

    Raises:
        ServiceError: As for `store_job`.
        StorageError: An application's archive cannot be read.
    """
    if draws_its_seed(request):
        return None
    current = applications or CurrentApplications(service)
    document = job_document(request, service, batch, current)
    results = find_results(document, contents_of_request(document.request, service, current), service)
    if results.job is None:
        return None
    reused = with_results_of(document, results.job)
    return _store(reused, "Completed", request, service, token, batch)


def draws_its_seed(request: SimulationJobRequestMembers) -> bool:
    """Returns whether each job of a request draws its own seed: no seed is given, and there are no trials."""
    return seed_of(request) is None and trials_of(request) is None


_FIRST_SEED_OF_TRIALS = 0
"""Seed of the first trial if the request gives none; the following trials count up."""


def job_document(
    request: SimulationJobRequestMembers,
    service: Service,
    batch: tuple[str, int] | None = None,
    applications: CurrentApplications | None = None,
) -> SimulationJobDocument:
    """Returns the document of a new simulation job, as the catalog stores it.

    Args:
        request: Request of a single job, or of one in a batch.
        service: The service, with its catalog and object store.
        batch: ARN and index of the batch; see `store_job`.
        applications: Source of applications; absent: the catalog.

    Raises:
        ServiceError: As for `store_job`.
    """
    wire = request.to_wire()
    current = applications or CurrentApplications(service)
    found = {role: _applications(wire, role, current) for role in _ROLES}
    world_name = None
    if (world := world_arn(wire)) is not None:
        resource = service.catalog.get(world, kind="world")
        check_rooms(request, resource, service)
        world_name = name_of_world(resource, service)
    check_output_location(wire.get("outputLocation"))
    data_sources = resolve_data_sources(wire.get("dataSources") or [], service, wire.get("iamRole"))
    seed, trials = seed_of(request), trials_of(request)
    if seed is None:
        seed = service.new_seed() if draws_its_seed(request) else _FIRST_SEED_OF_TRIALS
    return SimulationJobDocument(
        request=wire,
        request_index=batch[1] if batch else None,
        seed=seed,
        video=video_of(request) or "none",
        requirements=[each.to_wire() for each in requirements_of(request)],
        trials=trials.to_wire() if trials else None,
        data_sources=data_sources,
        robot_application_names=[each.name for each in found["robot"]],
        simulation_application_names=[each.name for each in found["simulation"]],
        world_name=world_name,
        application_arns={
            bare_name(role, config["application"]): each.arn
            for role, applications in found.items()
            for config, each in zip(wire.get(f"{role}Applications") or (), applications, strict=True)
            if not config["application"].startswith("arn:")
        },
        spec_run=service.spec_run.run_id if service.spec_run else None,
    )


def check_references(request: Mapping[str, Any], service: Service, applications: CurrentApplications) -> None:
    """Raises an error if the applications or world of a request do not exist.

    Args:
        request: Checked members of the request.
        service: The service, with its catalog and object store.
        applications: Source of applications.

    Raises:
        ServiceError: As for `store_job`.
    """
    for role in _ROLES:
        _applications(request, role, applications)
    if (world := world_arn(request)) is not None:
        service.catalog.get(world, kind="world")


def _store(
    document: SimulationJobDocument,
    status: str,
    request: SimulationJobRequestMembers,
    service: Service,
    token: ClientToken | None,
    batch: tuple[str, int] | None,
) -> Resource:
    labels = {
        "robotApplicationName": document.robot_application_names,
        "simulationApplicationName": document.simulation_application_names,
        **name_label(name_of_job(document)),
    }
    if document.made_of is not None:
        labels[REUSE_LABEL] = [ReuseInputs.of(document, document.made_of).key]
    return service.store_job(
        KIND,
        "sim",
        document,
        tags=request.tags,
        token=token,
        parent=batch[0] if batch else None,
        labels=labels,
        status=status,
    )


def _applications(request: Mapping[str, Any], role: ApplicationRole, current: CurrentApplications) -> list[Resource]:
    """Returns the applications of a role that a request names, after checking that all can be started.

    Raises `ResourceNotFoundException` if one does not exist, and `InvalidParameterException` if its launch
    configuration does not fit, or a policy is to be read from a container image.
    """
    found: list[Resource] = []
    follows_policy = role == "robot" and policy_in(request) is not None  # which says what of the archive is used
    for index, config in enumerate(request.get(f"{role}Applications") or []):
        application = current.find(config["application"], role, config.get("applicationVersion"))
        if follows_policy and image_of(application) is not None:
            raise InvalidParameterException(
                f"{role}Applications[{index}].application: {application.name} is a container image, whose files no "
                "policy is read from; give an application with an archive, an installed package, or a data source"
            )
        if not follows_policy:
            _check_launch(config["launchConfig"], application, f"{role}Applications[{index}].launchConfig")
        found.append(application)
    return found


def bare_name(role: str, name: str) -> str:
    """Returns the key under which a job's document stores the ARN of an application that is given by its bare name."""
    return f"{role} {name}"


def _check_launch(launch: Mapping[str, Any], application: Resource, place: str) -> None:
    """Raises `InvalidParameterException` if an archive's launch names nothing to start, or a built-in one's a file.

    The job worker tests the rest.
    """
    named = [member for member in ("packageName", "launchFile") if launch.get(member)]
    if named and is_builtin(application):
        raise InvalidParameterException(
            f"{place}.{named[0]}: {application.name} is built in, and starts without one; leave out "
            f"{' and '.join(named)}, which say what of an archive of your own is started"
        )
    has_archives = bool(ApplicationDocument.of(application).sources)
    if has_archives and not launch.get("command") and not (launch.get("packageName") and launch.get("launchFile")):
        raise InvalidParameterException(
            f"{place}: command, or packageName and launchFile, have to say what of the archive is started, "
            "such as my_nav and arena.make_environment"
        )
