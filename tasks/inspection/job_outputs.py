"""Inputs and outputs of simulation jobs, for reports and the table of results."""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError

from ...schemas.documents.simulation_jobs import ResolvedDataSource, SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.operations.registry import SEED_TAG, VIDEO_TAG
from ...schemas.reports.report import ReportedFile, ReportedJob
from ...schemas.reports.run_record import JobInputs, JobRecord, UsedApplication
from ...schemas.runs.axes import cell_in_tags
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.runs.plan import RunResult
from ...schemas.runs.programs import ApplicationRole
from ...schemas.runs.provenance import PROVENANCE_FILE
from ...schemas.runs.requirements import REQUIREMENTS_VARIABLE
from ...schemas.runs.trial_rows import TRIALS_FILE, TrialsSummary, trial_folder
from ...schemas.runs.trials import trials_in
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.common import counted
from ...schemas.wire.errors import InvalidParameterException, ObjectNotFoundError, StorageError
from ...schemas.wire.json_values import is_mapping
from ...schemas.worlds.world import WORLD_FILE
from ..comparison.compared_runs import TRIALS
from ..reporting import Drive
from ..results.columns import read_trials
from ..results.table import RESULTS_FILE, ResultTable
from ..runtime.episode.run_timeline import MAX_TIMELINE_BYTES, TIMELINE_FILE, read_timeline
from ..service.service import Service
from ..simulations.inputs.bundles import world_bundle
from ..simulations.planning.job_contents import requirements_in
from ..simulations.planning.run_plans import world_arn
from ..storage import read_manifest, removed_before
from ..storage.object_store import join_key

if TYPE_CHECKING:
    import pyarrow as pa


def outputs_of(place: StoredPlace | None, service: Service) -> tuple[list[ReportedFile], RunResult | None, bytes, int]:
    """Reads the outputs of a simulation run: file list, result, poster image (PNG), and number of removed files.

    Without outputs, or if they cannot be read, the parts are empty: no file, `None`, no bytes, 0. A run that left no
    manifest has only its list of files.
    """
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


def drawn_trial(
    place: StoredPlace | None, result: RunResult | None, files: Sequence[ReportedFile], service: Service
) -> tuple[int, RunResult] | None:
    """Reads the trial of a job whose path a report draws: the first recorded one that did not pass, else the first.

    Args:
        place: Place of the job's outputs.
        result: The job's result.
        files: The job's outputs.
        service: Service that stores them.

    Returns:
        Number and result of the trial; None: the job has no trials, or none that was recorded and can be read.
    """
    summary = TrialsSummary.of(result)
    if summary is None or place is None:
        return None
    names = {file.name for file in files}
    first = [each.trial for each in summary.failing] + summary.recorded
    number = next((each for each in first if f"{trial_folder(each)}/result.json" in names), None)
    if number is None:
        return None
    try:
        content = service.store.get_bytes(place.bucket, f"{place.prefix}/{trial_folder(number)}/result.json")
        return number, RunResult.model_validate_json(content)
    except (StorageError, ValidationError):
        return None


def drive_of(job: JobRecord, service: Service, trial: int | None = None) -> Drive:
    """Reads what a job, or one of its trials, left of its drive, for a page that shows it beside another one.

    Args:
        job: Record of the job.
        service: Service that stores its outputs and its world.
        trial: Number of the trial; None: the job itself. Of one that was not recorded nothing is left.
    """
    stored = service.catalog.get_many([job.arn] if job.arn else [])
    if not stored:
        return Drive(trouble="No job came of the request." if job.arn is None else "The job is deleted.")
    document = SimulationJobDocument.of(next(iter(stored.values())))
    files, result, _, _ = outputs_of(document.outputs, service)
    folder = "" if trial is None else f"{trial_folder(trial)}/"
    if trial is not None:
        files = [file for file in files if file.name.startswith(folder)]
        result = _result_of_trial(document.outputs, folder, files, service)
    world_json, content, trouble = _stored_world(document.request, service)
    return Drive(
        result=result,
        files=files,
        films_begin_s=_films_begin_s(document.outputs, files, service, folder),
        trial=trial,
        folder=folder,
        trials=trials_in(document.request),
        first_seed=document.seed,
        asked={str(each.get("name")): each for each in requirements_in(document.request) if is_mapping(each)},
        video_policy=str(
            document.request.get("video") or (document.request.get("tags") or {}).get(VIDEO_TAG) or "none"
        ),
        world_json=world_json,
        world_content=content,
        trouble=trouble,
    )


def _result_of_trial(
    place: StoredPlace | None, folder: str, files: Sequence[ReportedFile], service: Service
) -> RunResult | None:
    """Reads the result of a recorded trial; `None` if it was not recorded, or its result cannot be read."""
    name = f"{folder}result.json"
    if place is None or all(file.name != name for file in files):
        return None
    try:
        return RunResult.model_validate_json(service.store.get_bytes(place.bucket, join_key(place.prefix, name)))
    except (StorageError, ValidationError):
        return None


def _films_begin_s(
    place: StoredPlace | None, files: Sequence[ReportedFile], service: Service, folder: str
) -> dict[str, float]:
    """Returns the simulated time in seconds at which each video of a run begins, as its timeline says."""
    sizes = {file.name: file.size_bytes for file in files}
    name = folder + TIMELINE_FILE
    if place is None or sizes.get(name, MAX_TIMELINE_BYTES + 1) > MAX_TIMELINE_BYTES:
        return {}
    try:
        recorded = read_timeline(service.store.get_bytes(place.bucket, join_key(place.prefix, name)))
    except StorageError:
        return {}
    return {name: times.begins_s for name, times in recorded.videos.items()}


def digests_of(jobs: Sequence[JobRecord], service: Service) -> dict[str, str]:
    """Returns the digests of all states that jobs with axes went through, by label, as far as results have them.

    Args:
        jobs: Records of a run's jobs.
        service: Service that stores their outputs.
    """
    stored = service.catalog.get_many(job.arn for job in jobs if job.axes and job.arn)
    results = {arn: outputs_of(SimulationJobDocument.of(each).outputs, service)[1] for arn, each in stored.items()}
    return {
        job.label: result.state_digest
        for job in jobs
        if (result := results.get(job.arn or "")) is not None and result.state_digest
    }


def _stored_world(request: Mapping[str, Any], service: Service) -> tuple[Path | None, str, str]:
    """Returns the file of the world that a job's request names, the digest of its content, and why it cannot be read.

    The file is `None` and the texts are empty if the request names no world, or one that is not in the catalog.
    """
    arn = world_arn(request)
    world = service.catalog.get_many([arn]).get(arn) if arn else None
    bundle = WorldDocument.of(world).bundle if world is not None else None
    if world is None or bundle is None:
        return None, "", ""
    try:
        return world_bundle(world, service) / WORLD_FILE, bundle.last_part, ""
    except StorageError as error:
        return None, "", f"The world cannot be read: {error}."


def _unfinished(bucket: str, prefix: str, service: Service) -> list[ReportedFile]:
    """Lists the files of a crashed or killed run, which has no manifest; empty if the object store cannot be read."""
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
    """Makes a result from the verdict in the catalog, for a run whose result file cannot be read; a note says so."""
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
    """Returns where each job's outputs are in the object store, by the job's ARN; jobs without outputs are left out."""
    stored = service.catalog.get_many(job.arn for job in jobs if job.arn)
    found = {arn: SimulationJobDocument.of(resource).outputs for arn, resource in stored.items()}
    return {arn: place for arn, place in found.items() if place is not None}


def write_results(
    jobs: Sequence[JobRecord], places: Mapping[str, StoredPlace], service: Service, folder: Path
) -> ResultTable:
    """Writes the table of a run's results, with all trials of its jobs, into the run's folder, and returns it.

    If results of some jobs are lost by now, the table that was written before is kept and returned, if it can be
    read.
    """
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


def results_of(
    jobs: Sequence[JobRecord], service: Service, places: Mapping[str, StoredPlace] | None = None
) -> ResultTable:
    """Makes the table of some jobs' results, with all trials that are stored.

    Args:
        jobs: Records of the jobs, which may still be running.
        service: Service that stores their outputs.
        places: Places of their outputs, by ARN; None: those in the catalog.
    """
    if places is None:
        stored = service.catalog.get_many(job.arn for job in jobs if job.arn)
        found = {arn: SimulationJobDocument.of(resource).outputs for arn, resource in stored.items()}
        places = {arn: place for arn, place in found.items() if place is not None}
    return ResultTable.of(jobs, lambda job: _trials_of(job, places, service))


def _has_trials(job: JobRecord) -> bool:
    return any(item.name == TRIALS for item in job.requirements)


def _trials_of(job: JobRecord, places: Mapping[str, StoredPlace], service: Service) -> "pa.Table | None":
    """Reads the table of a job's trials; None if it has none, or the table was deleted."""
    place = places.get(job.arn or "")
    if place is None or not _has_trials(job):
        return None
    try:
        return read_trials(service.store.get_bytes(place.bucket, f"{place.prefix}/{TRIALS_FILE}"))
    except (StorageError, ValueError):
        return None


_APPLICATIONS = ("robotApplications", "simulationApplications")
_DECISIVE = (
    *_APPLICATIONS,
    "maxJobDurationInSeconds",
    "failureBehavior",
    "dataSources",
    "compute",
    "requirements",
    "policy",
)
"""Members of a request, besides seed and trials, that influence the result."""
_RECORDED = ("record", "record_failed")
"""Members of a request's trials that say which are recorded, which decides no verdict."""


def with_inputs(jobs: Sequence[ReportedJob], service: Service) -> list[ReportedJob]:
    """Returns the jobs of a run with their inputs (applications, world, request), for comparisons.

    If a job failed too early to record its applications, they are taken from the other jobs of the run, if those agree.
    """
    stored = service.catalog.get_many(job.arn for job in jobs if job.arn)
    documents = {arn: SimulationJobDocument.of(resource) for arn, resource in stored.items()}
    worlds = _world_contents({job.world_arn for job in jobs if job.world_arn}, service)
    inputs: list[JobInputs | None] = []
    for job in jobs:
        document = documents.get(job.arn or "")
        found = (
            inputs_of_request(document.request, document.seed, document.data_sources or []) if document else job.inputs
        )
        made_of = document.made_of if document else None
        # Worlds that are deleted are still told apart: by what their jobs say of them, else by their ARNs.
        world = (made_of and made_of.world) or worlds.get(job.world_arn or "", job.world_arn)
        used = _used_applications(document.outputs, service) if document else []
        inputs.append(found and found.model_copy(update={"world": world, "applications": used}))
    completed = _completed(inputs, [_names(documents.get(job.arn or "")) for job in jobs])
    return [
        job.model_copy(update={"inputs": each, "axes": axes_of(job, each)})
        for job, each in zip(jobs, completed, strict=True)
    ]


def axes_of(job: ReportedJob, inputs: JobInputs | None) -> dict[str, Value]:
    """Returns a job's value of each axis in a form that is the same in every run: the world's content, else names."""
    world = (inputs and inputs.world) or ""
    cell = cell_in_tags(job.request.get("tags"))
    return {name: world if value == job.world_arn and world else _named(value) for name, value in cell.items()}


def _named(value: Value) -> Value:
    if isinstance(value, str):
        with suppress(InvalidParameterException):
            return ResourceArn.parse(value).name
    return value


def inputs_of_request(
    request: Mapping[str, Any], seed: int | None, data: Sequence[ResolvedDataSource] = ()
) -> JobInputs:
    """Returns a simulation job's inputs as far as they are known from its request.

    Args:
        request: Request as in the API.
        seed: Seed of the job; None: the job was never created.
        data: Its data sources with the objects that were found; empty: it asks for none, or was never created.
    """
    given = request.get("seed", (request.get("tags") or {}).get(SEED_TAG))
    return JobInputs(
        seed=int(given) if seed is None and str(given).isdecimal() else seed,
        seed_given=given is not None,
        requirements_sha256=_requirements_digest(request),
        request_sha256=_digest_of(request),
        trials_and_data_sha256=_trials_and_data_digest(request, data),
    )


def _requirements_digest(request: Mapping[str, Any]) -> str | None:
    """Returns the hash of a request's requirements, from its member or the launch variable; `None` without any."""
    configs = [config for role in _APPLICATIONS for config in request.get(role) or ()]
    variables = [(config.get("launchConfig") or {}).get("environmentVariables") or {} for config in configs]
    asked = [request.get("requirements"), *(each.get(REQUIREMENTS_VARIABLE) for each in variables)]
    if not any(asked):
        return None
    return _sha256(asked)


def _trials_and_data_digest(request: Mapping[str, Any], data: Sequence[ResolvedDataSource]) -> str | None:
    """Returns the hash of a request's trials and of the contents of its data; `None` if these are not known.

    It is no part of `_digest_of`, as records of early releases lack it: their requests would all seem to have changed.
    """
    if request.get("dataSources") and not data:
        return None
    trials = request.get("trials")
    if is_mapping(trials):
        trials = {name: value for name, value in trials.items() if name not in _RECORDED}
    return _sha256([trials, [source.to_json() for source in data]])


def _digest_of(request: Mapping[str, Any]) -> str:
    asked = {name: request[name] for name in _DECISIVE if request.get(name) is not None}
    for role in _APPLICATIONS:
        if role in asked:
            asked[role] = [_without_arns(config) for config in asked[role]]
    return _sha256(asked)


def _sha256(asked: object) -> str:
    text = json.dumps(asked, sort_keys=True, default=str, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _without_arns(config: Mapping[str, Any]) -> dict[str, Any]:
    """Returns an application's configuration by name, without its worlds, as both are separate inputs."""
    plain = {key: value for key, value in config.items() if key != "worldConfigs"}
    with suppress(InvalidParameterException):  # it is a name already
        plain["application"] = ResourceArn.parse(str(config.get("application"))).name
    return plain


def _world_contents(arns: set[str], service: Service) -> dict[str, str]:
    """Returns the content hashes of worlds, by ARN; deleted worlds are left out."""
    worlds = service.catalog.get_many(arns)
    bundles = {arn: WorldDocument.of(world).bundle for arn, world in worlds.items()}
    return {arn: bundle.last_part for arn, bundle in bundles.items() if bundle}


class _Named(BaseModel):
    name: str


class _Program(BaseModel):
    role: ApplicationRole
    image_id: str | None = None


class _Plan(BaseModel):
    robot_application: _Named | None = None
    simulation_application: _Named | None = None
    programs: list[_Program] = []


class _Application(BaseModel):
    role: ApplicationRole
    name: str
    sha256: str


class _Provenance(BaseModel):
    """Part of `provenance.json` that identifies the applications; other releases may write other members."""

    plan: _Plan
    applications: list[_Application] = []


def _used_applications(place: StoredPlace | None, service: Service) -> list[UsedApplication]:
    """Reads a run's applications from its provenance; none if that cannot be read."""
    if place is None:
        return []
    try:
        content = service.store.get_bytes(place.bucket, join_key(place.prefix, PROVENANCE_FILE))
        provenance = _Provenance.model_validate_json(content)
    except (StorageError, ValidationError):
        return []
    plan = provenance.plan
    found: dict[tuple[ApplicationRole, str], str] = {
        (each.role, each.name): each.sha256 for each in provenance.applications
    }
    for program in plan.programs:
        application = plan.robot_application if program.role == "robot" else plan.simulation_application
        if program.image_id and application:
            found[program.role, application.name] = program.image_id
    return [UsedApplication(role=role, name=name, digest=digest) for (role, name), digest in sorted(found.items())]


def _names(document: SimulationJobDocument | None) -> set[tuple[str, str]]:
    """Returns role and name of the applications that a job requests."""
    if document is None:
        return set()
    robots, simulations = document.robot_application_names, document.simulation_application_names
    return {*(("robot", name) for name in robots), *(("simulation", name) for name in simulations)}


def _completed(inputs: Sequence[JobInputs | None], asked: Sequence[set[tuple[str, str]]]) -> list[JobInputs | None]:
    """Adds the applications that jobs request but did not record, if all other jobs used the same ones.

    An application that jobs used in several contents is not added.
    """
    known: dict[tuple[str, str], set[str]] = {}
    for each in inputs:
        for used in each.applications if each else ():
            known.setdefault((used.role, used.name), set()).add(used.digest)
    certain = {key: next(iter(digests)) for key, digests in known.items() if len(digests) == 1}
    completed: list[JobInputs | None] = []
    for each, names in zip(inputs, asked, strict=True):
        if each is None:
            completed.append(None)
            continue
        has = {(used.role, used.name) for used in each.applications}
        more = [
            UsedApplication.model_validate({"role": role, "name": name, "digest": certain[role, name]})
            for role, name in sorted(names - has)
            if (role, name) in certain
        ]
        completed.append(each.model_copy(update={"applications": [*each.applications, *more]}))
    return completed


def told_of_twins(jobs: Sequence[ReportedJob]) -> list[ReportedJob]:
    """Adds a note to jobs with identical states: an axis of their step, or their seed, has no effect."""
    twins: dict[str, list[ReportedJob]] = {}
    for job in jobs:
        if (states := _states_of(job)) is not None:
            twins.setdefault(states, []).append(job)
    idle = _idle_axes(jobs)
    told: list[ReportedJob] = []
    for job in jobs:
        same = twins.get(_states_of(job) or "", [])
        if job.result is not None and len(same) > 1:
            others = counted(len(same) - 1, "other job")
            note = f"this and {others} of the run went through the same states: they count once"
            if axes := [name for name in job.axes if (job.step, name) in idle and _differ(same, name)]:
                named = f"{'axis' if len(axes) == 1 else 'axes'} {' and '.join(axes)}"
                note = f"{named} changed nothing: {note}"
            job = job.model_copy(update={"result": job.result.model_copy(update={"notes": [*job.result.notes, note]})})
        told.append(job)
    return told


def _differ(jobs: Sequence[ReportedJob], axis: str) -> bool:
    return len({str(job.axes.get(axis)) for job in jobs}) > 1


def _idle_axes(jobs: Sequence[ReportedJob]) -> set[tuple[str | None, str]]:
    """Returns steps and axes without an effect: jobs that differ in one alone all went through the same states."""
    states: dict[tuple[str | None, str], dict[str, set[str | None]]] = {}
    values: Counter[tuple[str | None, str]] = Counter()
    for job in jobs:
        for name in job.axes:
            others = {axis: value for axis, value in job.axes.items() if axis != name}
            alike = states.setdefault((job.step, name), {}).setdefault(
                f"{job.world_arn} {job.seed} {sorted(others.items())}", set()
            )
            values[job.step, name] += bool(alike)
            alike.add(_states_of(job))
    return {axis for axis, groups in states.items() if values[axis] and all(len(each) == 1 for each in groups.values())}


def _states_of(job: ReportedJob) -> str | None:
    """Returns the hash of the states of a job's own run; None: its results were reused, or there is no hash."""
    result = job.result
    has_run = result is not None and job.reused_from is None and result.sim_time_s > 0
    return result.state_digest if result is not None and has_run else None
