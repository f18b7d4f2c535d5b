"""Preview of reuse: which results a run would reuse from earlier runs, which it would make anew, and why.

Nothing is run. The steps are followed as in a run, with existing results in place of those that they would create.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.documents.reuse_inputs import ReuseInputs, in_short
from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import WorldTemplateDocument
from ...schemas.operations.registry import parse_request, seed_of
from ...schemas.operations.simulation_job_batches import StartSimulationJobBatchRequest
from ...schemas.operations.simulation_jobs import CreateSimulationJobRequest, SimulationJobRequestMembers
from ...schemas.operations.world_generation_jobs import CreateWorldGenerationJobRequest
from ...schemas.operations.world_templates import CreateWorldTemplateRequest
from ...schemas.reports.run_record import StepRecord
from ...schemas.runs.plan import ApplicationRole
from ...schemas.specs.batch_splitting import parts_of
from ...schemas.specs.resolving import resolve_input
from ...schemas.specs.specification import CheckedSpec, CheckedStep
from ...schemas.templates.parsing import unwrapped_text
from ...schemas.wire.errors import RobomakerError, ServiceError, SpecError
from ..catalog import Resource
from ..service.service import Service
from ..simulations.planning.applications import LATEST, with_etag
from ..simulations.planning.job_contents import CurrentApplications, contents_of_request
from ..simulations.planning.run_plans import world_arn
from ..simulations.stored_jobs import draws_its_seed, find_results, job_document
from ..worlds.generation import world_seeds_of
from ..worlds.reuse import find_template_again, find_world_again
from .run_records import find_records

NO_SEED = "no seed is given, so each run draws its own"
NEW_WORLD = "its world is generated first"
_NEVER_RUN = "no job had these inputs yet"
_RUNS_LOOKED_AT = 20
_ROLES: Mapping[str, ApplicationRole] = {"CreateRobotApplication": "robot", "CreateSimulationApplication": "simulation"}


@dataclass(frozen=True)
class PlannedPart:
    """A world or simulation job of a step, with whether a run would reuse an earlier result or make it anew."""

    part: str
    """Label of the world or job: `world 2`, or `request 2` of a batch."""

    reuse: bool
    why: str
    """Earlier run or job whose result is reused, or the reason why it is made anew."""


@dataclass
class _Plan:
    """State of the plan: outputs of the steps planned so far, and the resources that they would create."""

    service: Service
    outputs: dict[str, dict[str, Any]] = field(default_factory=dict)
    templates: dict[str, str] = field(default_factory=dict)
    """Template bodies that steps would create, by ARN."""

    planned: dict[str, Resource] = field(default_factory=dict)
    """Applications that steps would create or change, by ARN, and by role and name."""

    new_worlds: set[str] = field(default_factory=set)
    last_steps: list[Mapping[str, StepRecord]] = field(default_factory=list)
    """Step records of earlier runs by step name, the newest run first."""
    jobs: dict[str, Mapping[int, SimulationJobDocument]] = field(default_factory=dict)
    """Jobs of earlier runs' steps by the index of their request, by the ARN of the step's job or batch."""

    @cached_property
    def applications(self) -> CurrentApplications:
        """Applications in the catalog as the run would find them at this step."""
        return CurrentApplications(self.service, self.planned)


def plan_reuse(checked: CheckedSpec, service: Service) -> dict[str, list[PlannedPart]]:
    """Determines which worlds and jobs of a specification a run with reuse would reuse or make anew.

    Args:
        checked: Specification.
        service: Service that stores earlier runs; nothing is changed.

    Returns:
        Worlds or jobs of each step that creates any, by step name.

    Raises:
        StorageError: The object store cannot be read.
    """
    plan = _Plan(service, last_steps=_steps_of_earlier_runs(checked.name, service))
    return {name: parts for name in checked.order if (parts := _plan_step(checked.steps[name], plan))}


def _plan_step(step: CheckedStep, plan: _Plan) -> list[PlannedPart]:
    try:
        members = resolve_input(step, plan.outputs)
        batches = [parse_request(step.operation, part.request) for part in parts_of(step.operation, members)]
    except (SpecError, ServiceError) as error:
        plan.outputs[step.name] = {}
        makes_parts = step.operation in ("CreateWorldGenerationJob", "CreateSimulationJob", "StartSimulationJobBatch")
        return [PlannedPart("all", reuse=False, why=f"known only in the run: {error}")] if makes_parts else []
    arn = plan.service.arn("world-template", f"planned-{step.name}")  # whatever it makes: nothing looks it up
    plan.outputs[step.name] = {"arn": arn}
    request = batches[0]
    if isinstance(request, CreateWorldTemplateRequest) and request.templateBody:
        plan.templates[arn] = _body_as_made(step, request, unwrapped_text(request.templateBody), plan.service)
    elif step.operation in _ROLES:
        plan.outputs[step.name] = _plan_application(step, members, plan)
    elif isinstance(request, CreateWorldGenerationJobRequest):
        return _plan_worlds(step.name, request, plan)
    elif isinstance(request, CreateSimulationJobRequest):
        return [_plan_job(step.name, 0, "job", request, plan)]
    elif isinstance(request, StartSimulationJobBatchRequest):
        more = [each for each in batches if isinstance(each, StartSimulationJobBatchRequest)]
        orders = [order for each in more for order in each.createSimulationJobRequests]
        return [_plan_job(step.name, i, f"request {i + 1}", order, plan) for i, order in enumerate(orders)]
    return []


def _body_as_made(step: CheckedStep, request: CreateWorldTemplateRequest, body: str, service: Service) -> str:
    """The body of a template as the run will have it: of one that is there already, as that one's was written."""
    if step.if_exists != "reuse":
        return body
    found = find_template_again(request.name or "", body, request.tags or {}, service)
    return body if found is None else WorldTemplateDocument.of(found).template_body


def _plan_application(step: CheckedStep, request: Mapping[str, Any], plan: _Plan) -> dict[str, Any]:
    """Returns the expected response of a step that creates an application, as far as jobs need it, and creates nothing.

    The application is noted in the plan, so that later steps find it. One that exists is taken over if the step says
    so.
    """
    role = _ROLES[step.operation]
    existing = plan.service.catalog.find(f"{role}-application", request["name"])
    if existing is not None and step.if_exists == "reuse":
        return {"arn": existing.arn, "name": existing.name}
    content = {"environment": request.get("environment"), "version": LATEST, "revisionId": "planned"}
    sources = [with_etag(source, i, plan.service) for i, source in enumerate(request.get("sources") or [])]
    document = ApplicationDocument.model_validate(
        {**content, "environment": None, "sources": sources} if sources else content
    )
    arn = existing.arn if existing is not None else plan.service.arn(f"{role}-application", f"{request['name']}/0")
    now = plan.service.clock()
    application = Resource(
        arn=arn,
        kind=f"{role}-application",
        id=request["name"],
        name=request["name"],
        document=document.to_json(),
        created_at=now,
        updated_at=now,
        revision=1,
    )
    plan.planned |= {arn: application, f"{role} {application.name}": application}
    return {"arn": arn, "name": application.name, "version": LATEST}


def _plan_worlds(step: str, request: CreateWorldGenerationJobRequest, plan: _Plan) -> list[PlannedPart]:
    plans, interiors = request.worldCount.floorplanCount or 1, request.worldCount.interiorCountPerFloorplan or 1
    seed, body, problem = seed_of(request), "", NO_SEED
    if seed is not None:
        try:
            body = plan.templates.get(request.template) or _stored_body(request.template, plan.service)
        except ServiceError as error:
            problem = str(error)
    parts, arns = [], []
    for index in range(plans * interiors):
        seeds = world_seeds_of(seed or 0, interiors, index, diversity=request.diversity)
        world = find_world_again(body, seeds, plan.service) if body else None
        if world is None:
            arns.append(plan.service.arn("world", f"{step}/world-{index + 1}"))
            plan.new_worlds.add(arns[-1])
            why = "no world of this template, seed and generator is there yet" if body else problem
        else:
            arns.append(world.arn)
            why = f"found in {world.id.rpartition('/')[0]}"
        parts.append(PlannedPart(f"world {index + 1}", reuse=world is not None, why=why))
    plan.outputs[step]["finishedWorldsSummary"] = {"finishedCount": len(arns), "succeededWorlds": arns}
    return parts


def _stored_body(template: str, service: Service) -> str:
    return WorldTemplateDocument.of(service.catalog.get(template, kind="world-template")).template_body


def _plan_job(step: str, index: int, part: str, request: SimulationJobRequestMembers, plan: _Plan) -> PlannedPart:
    wire = request.to_wire()
    if draws_its_seed(request):
        return PlannedPart(part, reuse=False, why=NO_SEED)
    if world_arn(wire) in plan.new_worlds:
        return PlannedPart(part, reuse=False, why=NEW_WORLD)
    try:
        document = job_document(request, plan.service, applications=plan.applications)
        made_of = contents_of_request(wire, plan.service, plan.applications)
    except RobomakerError as error:
        return PlannedPart(part, reuse=False, why=str(error))
    results = find_results(document, made_of, plan.service)
    if results.job is not None:
        earlier = SimulationJobDocument.of(results.job)
        origin = earlier.reused_from.spec_run if earlier.reused_from else earlier.spec_run
        return PlannedPart(part, reuse=True, why=f"results of {origin or results.job.id}")
    why = results.why_not or _what_changed(step, index, ReuseInputs.of(document, made_of), plan)
    return PlannedPart(part, reuse=False, why=why)


def _what_changed(step: str, index: int, inputs: ReuseInputs, plan: _Plan) -> str:
    """Describes what has changed since the last run of the specification that had this job."""
    for steps in plan.last_steps:
        document = _jobs_of(steps[step], plan).get(index) if step in steps else None
        if document is not None and document.made_of is not None:
            changes = inputs.changes_since(ReuseInputs.of(document, document.made_of))
            return in_short(changes) if changes else _NEVER_RUN
    return _NEVER_RUN


def _jobs_of(step: StepRecord, plan: _Plan) -> Mapping[int, SimulationJobDocument]:
    """Returns the jobs of an earlier run's step that are still in the catalog, by their request's index, from 0."""
    arn = step.arn or ""
    if arn not in plan.jobs:
        catalog = plan.service.catalog
        found = list(catalog.get_many([arn]).values()) if step.operation == "CreateSimulationJob" else []
        found += catalog.children(arn, kind="simulation-job") if arn else []
        documents = map(SimulationJobDocument.of, found)
        plan.jobs[arn] = {document.request_index or 0: document for document in documents}
    return plan.jobs[arn]


def _steps_of_earlier_runs(name: str, service: Service) -> list[Mapping[str, StepRecord]]:
    """Returns the steps of earlier runs of a specification, the newest first; reruns are left out."""
    records = find_records(service.settings.home / "runs", name, _RUNS_LOOKED_AT).records
    return [{step.name: step for step in record.steps} for record in reversed(records)]
