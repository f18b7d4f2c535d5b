"""Handlers of operations on world generation jobs, which make worlds from a template in several processes."""

from typing import Any

from ...schemas.documents.worlds import WorldGenerationJobDocument, WorldGenerationRequest, WorldTemplateDocument
from ...schemas.operations.registry import seed_of
from ...schemas.operations.world_generation_jobs import (
    CancelWorldGenerationJobRequest,
    CreateWorldGenerationJobRequest,
    DescribeWorldGenerationJobRequest,
    ListWorldGenerationJobsRequest,
)
from ..catalog import ClientToken, Resource
from ..execution.leases.leased_runs import run_under_lease
from ..jobs.world_jobs import NO_FAILURES, cancel_world_job, in_order, plan_count, run_generation
from ..service.service import Service
from .registry import Answer, operation, page_of

KIND = "world-generation-job"


def perform_world_generation_job(arn: str, service: Service) -> None:
    """Runs a world generation job: generates its missing worlds, and sets the job's final status.

    Blocks until the job has ended, also if another process runs it.
    """
    run_under_lease(arn, KIND, service, lambda lease: run_generation(lease, service))


@operation("CreateWorldGenerationJob", perform=perform_world_generation_job)
def create_world_generation_job(request: CreateWorldGenerationJobRequest, service: Service) -> Answer:
    """Handles `CreateWorldGenerationJob`: stores a generation job with a copy of the template's current body.

    A request with a known client token returns the job that it has stored before. The job is not run here.
    """
    token = ClientToken.of("CreateWorldGenerationJob", request)
    job = service.find_by_client_token(token) or _stored(request, token, service)
    return _described(job)


def _stored(request: CreateWorldGenerationJobRequest, token: ClientToken | None, service: Service) -> Resource:
    template = service.catalog.get(request.template, kind="world-template")
    seed = seed_of(request)
    return service.store_job(
        KIND,
        "generation",
        WorldGenerationJobDocument(
            request=WorldGenerationRequest.model_validate(request.to_wire()),
            template_body=WorldTemplateDocument.of(template).template_body,
            template_name=template.name or None,
            seed=service.new_seed() if seed is None else seed,
            reuse=service.reuses and seed is not None,
        ),
        tags=request.tags,
        token=token,
        labels={"templateId": [template.id]},
    )


@operation("DescribeWorldGenerationJob")
def describe_world_generation_job(request: DescribeWorldGenerationJobRequest, service: Service) -> Answer:
    """Handles `DescribeWorldGenerationJob`: returns the job, the worlds finished so far, and its failures by code."""
    job = service.catalog.get(request.job, kind=KIND)
    document = WorldGenerationJobDocument.of(job)
    worlds, plans = document.succeeded_worlds, document.plan_count
    if worlds is None:
        made = service.catalog.children(job.arn, kind="world")
        worlds, plans = in_order(world.arn for world in made), plan_count(made)
    failures = document.failures or NO_FAILURES
    response = _described(job)
    response["failureReason"] = document.failure_reason
    response["finishedWorldsSummary"] = {
        "finishedCount": len(worlds) + failures.total_failure_count,
        "succeededWorlds": worlds,
        "failureSummary": failures.to_json(),
        "planCount": plans,
    }
    return response


@operation("ListWorldGenerationJobs")
def list_world_generation_jobs(request: ListWorldGenerationJobsRequest, service: Service) -> Answer:
    """Handles `ListWorldGenerationJobs`: returns a page of generation jobs, newest first, and the next page's token."""
    page = page_of(request, KIND, service, "status", "templateId")
    return {
        "worldGenerationJobSummaries": [_summary(job, service) for job in page.resources],
        "nextToken": page.next_token,
    }


@operation("CancelWorldGenerationJob")
def cancel_world_generation_job(request: CancelWorldGenerationJobRequest, service: Service) -> Answer:
    """Handles `CancelWorldGenerationJob`: cancels a generation job; its finished worlds stay.

    A running job is cancelled as soon as its job worker notices. Cancelling one that has ended changes nothing and
    succeeds.
    """
    cancel_world_job(request.job, KIND, service, lambda lease: run_generation(lease, service))
    return {}


def _summary(job: Resource, service: Service) -> dict[str, Any]:
    document = WorldGenerationJobDocument.of(job)
    worlds = document.succeeded_worlds
    succeeded = sum(service.catalog.count_children(job.arn, "world").values()) if worlds is None else len(worlds)
    request = document.request
    return {
        "arn": job.arn,
        "template": request.template,
        "createdAt": job.created_at,
        "status": job.status,
        "worldCount": request.world_count.to_json(),
        "succeededWorldCount": succeeded,
        "failedWorldCount": (document.failures or NO_FAILURES).total_failure_count,
    }


def _described(job: Resource) -> dict[str, Any]:
    document = WorldGenerationJobDocument.of(job)
    request = document.request
    return {
        "arn": job.arn,
        "status": job.status,
        "createdAt": job.created_at,
        "failureCode": document.failure_code,
        "clientRequestToken": request.client_request_token,
        "template": request.template,
        "worldCount": request.world_count.to_json(),
        "tags": dict(job.tags),
        "worldTags": request.world_tags or {},
    }
