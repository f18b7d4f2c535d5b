"""Flows that can be deployed to a Prefect server, and what they need to run: objects, packages, container images."""

import hashlib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...schemas.operations.registry import OPERATIONS
from ...schemas.specs.parameters import Parameter
from ...schemas.specs.specification import CheckedSpec
from ...schemas.specs.yaml_nodes import plain
from ...schemas.wire.errors import ConfigurationError
from ...tasks.backends.backend import JOB_WORKER_FLOW
from ...tasks.operations.registry import Operation, registry

_PACKAGE = "python://"


@dataclass(frozen=True)
class Need:
    """Something that has to exist when a specification's step runs, such as an archive."""

    step: str
    uri: str
    """URI of the needed object: `s3://BUCKET/KEY`, `python://MODULE`, or a container image."""

    @property
    def sentence(self) -> str:
        """Returns a description of an object, package or image that a step needs, with the step's name."""
        if self.uri.startswith("s3://"):
            return f"{self.uri} in the object store (step {self.step})"
        if self.uri.startswith(_PACKAGE):
            return f"the Python package {self.uri.removeprefix(_PACKAGE)}, installed where jobs run (step {self.step})"
        return f"the container image {self.uri} (step {self.step})"


def needs_of(spec: CheckedSpec) -> list[Need]:
    """Lists the needs of a specification's steps, as far as known before the run."""
    found = [Need(name, uri) for name in spec.order for uri in _uris(plain(spec.steps[name].input))]
    return list({need.uri: need for need in reversed(found)}.values())[::-1]


def _uris(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        bucket, key, keys = value.get("s3Bucket"), value.get("s3Key"), value.get("s3Keys")
        for each in [key, *(keys if isinstance(keys, list) else [])]:
            if isinstance(bucket, str) and isinstance(each, str) and "${{" not in bucket + each:
                yield f"s3://{bucket}/{each}"
        uri = value.get("uri")
        if isinstance(uri, str) and "${{" not in uri:
            yield uri
        for inner in value.values():
            yield from _uris(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _uris(inner)


TAG = "robomaker"
"""Tag of every Prefect deployment of this package."""
_FLOWS = "prefect_robomaker.flows"
_MOST_BYTES = 400_000  # Prefect takes 512 kB of parameters, as JSON


@dataclass(frozen=True)
class Deployable:
    """A Prefect flow with the name, description and parameters of its deployment."""

    flow: str
    entrypoint: str
    """Dotted path of the flow; without a colon, so that workers import it wherever they are."""

    name: str
    description: str
    tags: tuple[str, ...]
    version: str | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])
    own_parameters: Mapping[str, Parameter] | None = None
    """Parameters of its specification, in addition to those of the flow; `None`: it has no specification."""

    values: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Default values of the specification's parameters in runs of a deployment."""

    missing: tuple[str, ...] = ()
    """Names of a deployment's parameters without a value, which each run must be given."""

    @property
    def full_name(self) -> str:
        """Full name for `prefect deployment run`: flow name and deployment name."""
        return f"{self.flow}/{self.name}"


def deployment_name(flow: str) -> str:
    """Returns the deployment's name for an operation's flow, spelled as in the AWS CLI."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", flow).lower()


def operation_deployables() -> list[Deployable]:
    """Returns the flows of all API operations, and those that run stored jobs, for deployment."""
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
    """Returns the job worker's flow for deployment in a work pool.

    `ROBOMAKER_BACKEND=workers:POOL` finds it by its name.
    """
    return Deployable(
        flow=JOB_WORKER_FLOW,
        entrypoint=f"{_FLOWS}.pool_job_workers.{JOB_WORKER_FLOW}",
        name=pool,
        description=(
            "A job worker: takes jobs of a batch from the catalog and runs them on the machine of its Prefect worker, "
            "until none is left."
        ),
        tags=(TAG, "job-worker"),
    )


def spec_deployable(
    spec: CheckedSpec,
    *,
    origin: str,
    name: str | None = None,
    tags: Sequence[str] = (),
    given: Collection[str] = (),
) -> Deployable:
    """Returns a specification for deployment as a Prefect flow.

    Args:
        spec: The specification, checked.
        origin: Name of its file, which problems of a run mention.
        name: Name of the deployment; absent: the specification's.
        tags: More tags.
        given: Parameters whose values the deployment keeps, in place of the specification's defaults.

    Raises:
        ConfigurationError: The specification is longer than the parameters that Prefect accepts.
    """
    size = len(spec.text.encode())
    if size > _MOST_BYTES:
        raise ConfigurationError(
            f"{origin} has {size} bytes; a deployment keeps at most {_MOST_BYTES}: split it, or shorten it by `forEach`"
        )
    return Deployable(
        flow="RunPipeline",
        # A worker of an earlier release runs what has no parameters, and refuses the rest.
        entrypoint=f"{_FLOWS}.{'deployed_pipelines' if spec.declared else 'pipelines'}.RunPipeline",
        name=name or spec.name,
        description=_described(spec),
        tags=tuple(dict.fromkeys((TAG, "specification", *tags))),
        version=hashlib.sha256(spec.text.encode()).hexdigest()[:12],
        parameters={
            "text": spec.text,
            "origin": origin,
            **{parameter: value for parameter, value in spec.parameters.items() if parameter in given},
        },
        own_parameters=spec.declared,
        values=spec.parameters,
        missing=spec.missing,
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
