"""World generation jobs: worlds from a template, several processes at a time."""

import os
import threading
from typing import Any

from ..schemas.common import shorten
from ..schemas.ids import world_id
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
    perform_once(arn, KIND, service, lambda lease: GenerationRun(lease, service).run())


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
    return service.store_job(
        KIND,
        "generation",
        {
            "request": request.to_wire(),
            "templateBody": template.document["templateBody"],
            "seed": service.new_seed() if seed is None else seed,
        },
        tags=request.tags,
        token=token,
    )


@operation("DescribeWorldGenerationJob")
def describe_world_generation_job(
    request: DescribeWorldGenerationJobRequest, service: Service
) -> DescribeWorldGenerationJobResponse:
    """Tells how a generation job stands, with the worlds finished so far."""
    job = service.catalog.get(request.job, kind=KIND)
    worlds = [world.arn for world in service.catalog.children(job.arn, kind="world")]
    # By number, not by who was finished first: what a specification makes of the list is the same every time.
    worlds.sort(key=lambda arn: int(arn.rpartition("-")[2]))
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


class GenerationRun:
    """One performer's work on one generation job.

    Args:
      lease: the right to change the job.
      service: where it is stored.
    """

    def __init__(self, lease: Lease, service: Service) -> None:
        self._lease = lease
        self._service = service
        self._job = job = lease.job
        count = job.document["request"]["worldCount"]
        self._total = count["floorplanCount"] * count["interiorCountPerFloorplan"]
        self._lock = threading.Lock()
        self._done = 0
        self._failures: list[dict[str, Any]] = []

    def run(self) -> None:
        """Generates every world that does not exist and ends the job."""
        if self._job.status == "Pending":
            self._lease.transition("start")
        exist = {world.arn for world in self._service.catalog.children(self._job.arn, kind="world")}
        self._done = len(exist)
        arns = [self._service.arn("world", world_id(self._job.id, number)) for number in range(1, self._total + 1)]
        missing = [(index, arn) for index, arn in enumerate(arns) if arn not in exist]
        if missing and not self.stopped():
            self._generate(missing)
        self._settle()

    def stopped(self) -> bool:
        """Whether no more worlds are wanted."""
        return self._lease.lost or self._service.catalog.cancel_requested(self._job.arn)

    def ended(self, failure: dict[str, Any] | None) -> None:
        """Counts a world that was made, or why there is none; called from several threads."""
        with self._lock:
            if failure:
                self._failures.append(failure)
            else:
                self._done += 1
            done, failed = self._done, len(self._failures)
        pending = self._total - done - failed
        self._service.report_progress(Progress({"succeeded": done, "failed": failed, "pending": pending}, self._total))

    def _generate(self, missing: list[tuple[int, str]]) -> None:
        from ..tasks.task_pool import run_tasks
        from ..tasks.world_builders import WorldBuilders
        from ..tasks.world_generation import generate_and_store

        workers = min(len(missing), os.cpu_count() or 1)
        with WorldBuilders(workers, self._service.folder("logs") / "world-builders.log") as builders:

            def look() -> None:
                if self.stopped():
                    builders.stop()

            run_tasks(
                generate_and_store,
                [
                    {"run": self, "job": self._job, "index": index, "world_arn": arn, "builders": builders}
                    for index, arn in missing
                ],
                workers=workers,
                job_arn=self._job.arn,
                service=self._service,
                look=look,
            )

    def _settle(self) -> None:
        from ..tasks.world_generation import failure_summary

        summary = failure_summary(self._failures)
        if self._done + len(self._failures) < self._total:
            if self._lease.job.status != "Canceling":
                self._lease.transition("cancel")
            self._lease.transition("canceled", failures=summary)
        elif not self._failures:
            self._lease.transition("complete", failures=summary)
        elif len(self._failures) < self._total:
            self._lease.transition("partially_fail", failures=summary)
        else:
            reason = shorten(self._failures[0]["reason"])
            self._lease.transition(
                "fail", failures=summary, failureCode="AllWorldGenerationFailed", failureReason=reason
            )


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
