"""Passes of a probe: runs of a specification that is cut down, after which the whole run finds its names free."""

import resource
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime

from ....flows.pipelines import run_spec
from ....schemas.reports.progress import ProgressEvent, ProgressListener, StepEnded, StepStarted
from ....schemas.reports.run_record import RunRecord
from ....schemas.settings import Settings
from ....schemas.specs.model import CheckedSpec
from ....schemas.specs.probe_requests import ProbeSize, cut
from ....schemas.wire.errors import ResourceNotFoundException, RobomakerError
from ....tasks.inspection.pipeline_parts import RunInterrupted
from ....tasks.operations.registry import call
from ....tasks.service.service import Service

_LONGEST_NAME = 94
_DELETED_AFTERWARDS = {
    "CreateRobotApplication": ("DeleteRobotApplication", "application"),
    "CreateSimulationApplication": ("DeleteSimulationApplication", "application"),
    "CreateWorldTemplate": ("DeleteWorldTemplate", "template"),
}


class ProbeFailedError(RobomakerError):
    """A probe did not come to its end, so that nothing can be forecast.

    Args:
        record: the pass that failed.
    """

    def __init__(self, record: RunRecord) -> None:
        errors = [f"{step.name} ({step.operation}): {step.error}" for step in record.steps if step.error]
        errors += [f"{job.label}: {job.failure_reason}" for job in record.jobs if job.failure_reason]
        why = "; ".join(errors) or f"see {record.report_path or record.run_dir}"
        super().__init__(f"nothing can be forecast, the probe {record.run_id} is {record.state}: {why}")


@dataclass
class CpuTimes:
    """Listens to a run, and measures the CPU time of the processes that each step started and that have ended."""

    listener: ProgressListener
    by_step: dict[str, float] = field(default_factory=dict[str, float])
    """Seconds, by the step's name."""
    _before_s: float = 0.0

    def __call__(self, event: ProgressEvent, /) -> None:
        """Takes one event."""
        if isinstance(event, StepStarted):
            self._before_s = _of_children_s()
        elif isinstance(event, StepEnded):
            self.by_step[event.step] = _of_children_s() - self._before_s
        self.listener(event)


def _of_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run_pass(
    spec: CheckedSpec, settings: Settings, size: ProbeSize, listener: ProgressListener, spec_path: str
) -> RunRecord:
    """Runs one pass, and deletes what the whole run is to make itself.

    Args:
        spec: the specification.
        settings: where everything is kept, with the backend.
        size: how much of it is run.
        listener: told how it goes.
        spec_path: the file that the specification is from.

    Raises:
        ProbeFailedError: it did not come to its end.
        RunInterrupted: Ctrl-C was pressed.
    """
    quiet = settings.model_copy(update={"notify": ()})
    service = Service.open(quiet)
    began = service.clock()
    named = replace(spec, name=f"{spec.name[:_LONGEST_NAME]}-probe")
    command = ["robomaker", "plan", spec_path, "--probe"]
    try:
        record = run_spec(
            named,
            quiet,
            listener,
            spec_path=spec_path,
            command=command,
            cut=lambda operation, request: cut(operation, request, size),
        )
    except RunInterrupted as interruption:
        delete_made(interruption.record, began, service)
        raise
    delete_made(record, began, service)
    if record.state not in ("succeeded", "failed"):  # a job whose verdict is FAIL took as long as any
        raise ProbeFailedError(record)
    return record


def delete_made(record: RunRecord, since: datetime, service: Service) -> None:
    """Deletes the applications and templates that a run has made; those that were there before stay.

    Args:
        record: the run.
        since: what is older was there before.
        service: where they are stored.
    """
    for step in reversed(record.steps):
        arn = step.arn or step.output.get("arn")
        if arn is None or step.operation not in _DELETED_AFTERWARDS:
            continue
        delete, member = _DELETED_AFTERWARDS[step.operation]
        with suppress(ResourceNotFoundException):
            if service.catalog.get(arn).created_at >= since:
                call(delete, {member: arn}, service)
