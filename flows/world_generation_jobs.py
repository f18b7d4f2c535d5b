"""World generation jobs: worlds from a template, several processes at a time."""

import os
from typing import Any

from ..schemas.ids import new_id, world_id
from ..schemas.operations import seed_of
from ..schemas.world_generation_jobs import (
    CreateWorldGenerationJobRequest,
    CreateWorldGenerationJobResponse,
    DescribeWorldGenerationJobRequest,
    DescribeWorldGenerationJobResponse,
)
from ..tasks.catalog import ClientToken, Resource
from ..tasks.performing import Lease, perform_once
from ..tasks.service import Progress, Service
from .operation import flows_of, operation

KIND = "world-generation-job"


def perform_world_generation_job(arn: str, service: Service) -> None:
    """Generates the job's worlds that do not exist yet and ends the job."""
    perform_once(arn, KIND, service, lambda lease: _generate(lease, service))


@operation("CreateWorldGenerationJob", perform=perform_world_generation_job, describe="DescribeWorldGenerationJob")
def create_world_generation_job(
    request: CreateWorldGenerationJobRequest, service: Service
) -> CreateWorldGenerationJobResponse:
    """Stores a generation job; the template's body is kept as it is now."""
    token = ClientToken.of("CreateWorldGenerationJob", request)
    job = service.made_before(token) or _stored(request, token, service)
    return CreateWorldGenerationJobResponse.model_validate(_described(job))


def _stored(request: CreateWorldGenerationJobRequest, token: ClientToken | None, service: Service) -> Resource:
    template = service.catalog.get(request.template, kind="world-template")
    seed = seed_of(request)
    job_id = new_id("generation", service.chance)
    return service.catalog.create(
        Resource.new(
            arn=service.arn(KIND, job_id),
            kind=KIND,
            id=job_id,
            name="",
            status="Pending",
            tags=request.tags or {},
            document={
                "request": request.to_wire(),
                "templateBody": template.document["templateBody"],
                "seed": service.new_seed() if seed is None else seed,
            },
        ),
        token=token,
    )


@operation("DescribeWorldGenerationJob")
def describe_world_generation_job(
    request: DescribeWorldGenerationJobRequest, service: Service
) -> DescribeWorldGenerationJobResponse:
    """Tells how a generation job stands, with the worlds finished so far."""
    job = service.catalog.get(request.job, kind=KIND)
    worlds = [world.arn for world in service.catalog.children(job.arn, kind="world")]
    failures = job.document.get("failures") or {"totalFailureCount": 0, "failures": []}
    response = _described(job)
    response["failureReason"] = job.document.get("failureReason")
    response["finishedWorldsSummary"] = {
        "finishedCount": len(worlds) + failures["totalFailureCount"],
        "succeededWorlds": worlds,
        "failureSummary": failures,
    }
    return DescribeWorldGenerationJobResponse.model_validate(response)


def _described(job: Resource) -> dict[str, Any]:
    request = job.document["request"]
    return {
        "arn": job.arn,
        "status": job.status,
        "createdAt": job.created_at,
        "failureCode": job.document.get("failureCode"),
        "clientRequestToken": request.get("clientRequestToken"),
        "template": request["template"],
        "worldCount": request["worldCount"],
        "tags": dict(job.tags),
        "worldTags": request.get("worldTags") or {},
    }


def _generate(lease: Lease, service: Service) -> None:
    count = lease.job.document["request"]["worldCount"]
    total = count["floorplanCount"] * count["interiorCountPerFloorplan"]
    if lease.job.status == "Pending":
        lease.transition("start")
    _end(lease, total, _generate_missing(lease.job, total, service), service)


def _generate_missing(job: Resource, total: int, service: Service) -> list[dict[str, Any]]:
    """Generates what is missing; returns the failures."""
    from prefect.task_runners import ThreadPoolTaskRunner

    from ..tasks.world_builders import WorldBuilders
    from ..tasks.world_generation import generate_and_store

    exist = {world.arn for world in service.catalog.children(job.arn, kind="world")}
    arns = [service.arn("world", world_id(job.id, number)) for number in range(1, total + 1)]
    missing = [index for index, arn in enumerate(arns) if arn not in exist]
    workers = max(1, min(len(missing), os.cpu_count() or 1))
    failures: list[dict[str, Any]] = []
    done = len(exist)
    with (
        service.activated(),
        WorldBuilders(workers, service.folder("logs") / "world-builders.log") as builders,
        ThreadPoolTaskRunner(max_workers=workers) as runner,
    ):
        futures = [
            runner.submit(
                generate_and_store,
                {"job": job, "index": index, "world_arn": arns[index], "builders": builders},
            )
            for index in missing
        ]
        for future in futures:
            if failure := future.result():
                failures.append(failure)
            else:
                done += 1
            waiting = total - done - len(failures)
            service.report_progress(Progress({"succeeded": done, "failed": len(failures), "pending": waiting}, total))
    return failures


def _end(lease: Lease, total: int, failures: list[dict[str, Any]], service: Service) -> None:
    from ..tasks.world_generation import failure_summary

    summary = failure_summary(failures)
    if service.catalog.cancel_requested(lease.job.arn):
        lease.transition("cancel", failures=summary)
        lease.transition("canceled")
    elif not failures:
        lease.transition("complete", failures=summary)
    elif len(failures) < total:
        lease.transition("partially_fail", failures=summary)
    else:
        reason = failures[0]["reason"][:1024]
        lease.transition("fail", failures=summary, failureCode="AllWorldGenerationFailed", failureReason=reason)


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
