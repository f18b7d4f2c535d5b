"""Deployables of a Prefect server: every operation's flow, specifications, and the job worker of a work pool.

A deployment of an operation is called as the AWS CLI calls the operation: `create-world-template`. One of a
specification has the specification's name, and keeps its text as a parameter, so that a worker needs no copy of the
file.
"""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...schemas.operations.registry import OPERATIONS
from ...schemas.specs.model import CheckedSpec
from ...schemas.wire.errors import ConfigurationError
from ...tasks.backends.backend import JOB_WORKER_FLOW
from ...tasks.operations.registry import Operation, registry
from .needs import needs_of

TAG = "robomaker"
"""A tag of every deployment."""
_FLOWS = "prefect_robomaker.flows"
_MOST_BYTES = 400_000  # Prefect takes 512 kB of parameters, as JSON


@dataclass(frozen=True)
class Deployable:
    """A flow with what a deployment of it is called, says and keeps."""

    flow: str
    entrypoint: str
    """Dotted path of the flow; without a colon, so that workers import it wherever they are."""

    name: str
    description: str
    tags: tuple[str, ...]
    version: str | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def full_name(self) -> str:
        """Full name for `prefect deployment run`: the flow's name and the deployment's."""
        return f"{self.flow}/{self.name}"


def deployment_name(flow: str) -> str:
    """The name of the deployment of an operation's flow, as the AWS CLI writes the operation."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", flow).lower()


def operation_deployables() -> list[Deployable]:
    """The flows of all operations, and those that carry stored jobs to their end, by module and name."""
    entries = registry().values()
    made = [_of_operation(entry, entry.name, OPERATIONS[entry.name].description, "operation") for entry in entries]
    makers: dict[str, list[Operation]] = {}  # a deployment job has two
    for entry in entries:
        if entry.run_job:
            makers.setdefault(entry.perform_name, []).append(entry)
    for flow, some in makers.items():
        text = f"Carries the job of an ARN, made by {' or '.join(entry.name for entry in some)}, to its end."
        made.append(_of_operation(some[0], flow, text, "perform"))
    return sorted(made, key=lambda each: each.entrypoint)


def job_worker_deployable(pool: str) -> Deployable:
    """The flow that takes jobs of batches, in a work pool: `ROBOMAKER_BACKEND=workers:POOL` finds it by its name."""
    return Deployable(
        flow=JOB_WORKER_FLOW,
        entrypoint=f"{_FLOWS}.simulation_job_batches.{JOB_WORKER_FLOW}",
        name=pool,
        description=(
            "A job worker: takes jobs of a batch from the catalog and runs them on the machine of its Prefect worker, "
            "until none is left."
        ),
        tags=(TAG, "job-worker"),
    )


def spec_deployable(spec: CheckedSpec, *, origin: str, name: str | None = None, tags: Sequence[str] = ()) -> Deployable:
    """A specification, kept with its deployment.

    Args:
        spec: the specification, checked.
        origin: where it came from; problems of a run name it.
        name: of the deployment; absent: the specification's.
        tags: more tags.

    Raises:
        ConfigurationError: it is longer than Prefect takes.
    """
    size = len(spec.text.encode())
    if size > _MOST_BYTES:
        raise ConfigurationError(
            f"{origin} has {size} bytes; a deployment keeps at most {_MOST_BYTES}: split it, or shorten it by `forEach`"
        )
    return Deployable(
        flow="RunPipeline",
        entrypoint=f"{_FLOWS}.pipelines.RunPipeline",
        name=name or spec.name,
        description=_described(spec),
        tags=tuple(dict.fromkeys((TAG, "specification", *tags))),
        version=hashlib.sha256(spec.text.encode()).hexdigest()[:12],
        parameters={"text": spec.text, "origin": origin},
    )


def _of_operation(entry: Operation, flow: str, description: str, role: str) -> Deployable:
    return Deployable(
        flow=flow,
        entrypoint=f"{_FLOWS}.operations.{flow}",
        name=deployment_name(flow),
        description=description,
        tags=(TAG, role, entry.resource.replace("_", "-")),
    )


def _described(spec: CheckedSpec) -> str:
    """Describes the deployment of a specification in Markdown, for Prefect's pages."""
    steps = [f"{number}. `{name}`: {spec.steps[name].operation}" for number, name in enumerate(spec.order, 1)]
    needs = [f"- {need.sentence}" for need in needs_of(spec)]
    parts = [spec.description, "\n".join(steps), *(["It needs:\n\n" + "\n".join(needs)] if needs else [])]
    return "\n\n".join(part for part in parts if part)
