"""Unsigned API requests of a job's own processes: recognises the job, and limits it to calls about itself.

Without access keys each program of this machine may call the service, and so could the programs of a job, which are not
trusted. The kernel says which process has a connection open.
"""

import hmac
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import unquote

from starlette.types import Scope

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.runs.variables import OF_JOB
from ....schemas.wire.operation_shape import OperationShape
from ....tasks.catalog import Resource
from ....tasks.runtime.sandbox.local_callers import Callers, as_address
from ....tasks.service.service import Service
from ..connections import ENDS
from ..protocol_errors import AccessDeniedException
from .scopes import named_resources

_OF_ITSELF = frozenset(
    {
        "DescribeSimulationJob",
        "BatchDescribeSimulationJob",
        "CancelSimulationJob",
        "TagResource",
        "UntagResource",
        "ListTagsForResource",
    }
)
"""Operations that a job may call about itself."""

_OF_WHAT_IT_USES = frozenset(
    {"DescribeWorld", "DescribeRobotApplication", "DescribeSimulationApplication", "ListTagsForResource"}
)
"""Operations that a job may call about the world and the applications in its request."""

_CREATE = "CreateSimulationJob"
_RUNS = ("Preparing", "Running", "RunningFailed", "Restarting")
"""Statuses in which a job's code may be running."""
_ROLES = ("robotApplications", "simulationApplications")


class JobCallers:
    """Recognises API requests of simulation jobs, which have fewer rights.

    Args:
        service: The service; only jobs of job workers with its data home are recognised.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._callers = Callers(service.settings.home)

    def job_of_path(self, scope: Scope) -> str | None:
        """Returns the ARN of the job whose own URL path is used, and removes that from the path.

        So processes in containers, whose connections say nothing of their jobs, and those of job workers elsewhere are
        known too.

        Raises:
            AccessDeniedException: The path is not that of a running job.
        """
        path = scope["raw_path"].decode("latin-1")
        if not path.startswith(OF_JOB):
            return None
        job_id, _, rest = path.removeprefix(OF_JOB).partition("/")
        key, slash, rest = rest.partition("/")
        found = self._service.catalog.get_many([arn := self._service.arn("simulation-job", job_id)]).get(arn)
        known = SimulationJobDocument.of(found).call_key if found is not None and found.status in _RUNS else None
        if not hmac.compare_digest((known or "").encode(), key.encode()) or not known:
            raise AccessDeniedException("there is no job that runs with this key")
        scope["raw_path"] = f"{slash}{rest}".encode("latin-1") or b"/"
        scope["path"] = unquote(scope["raw_path"].decode("latin-1"))
        return arn

    def job_of(self, scope: Scope) -> str | None:
        """Returns the ARN of the job that sent a request; `None` if no job did.

        Raises:
            AccessDeniedException: The caller's process cannot be determined, so that it may belong to any job.
        """
        peer, server = map(as_address, scope.get("state", {}).get(ENDS, (None, None)))
        if peer is None or server is None:  # it came over no connection
            return None
        caller = self._callers.who(peer, server)
        if caller.why_unknown is not None:
            raise AccessDeniedException(
                f"it cannot be told whether a job sent this request: {caller.why_unknown}; "
                "keep the connection open until the answer is there, or have the service check access keys"
            )
        return caller.job

    def check(self, arn: str, shape: OperationShape, members: Mapping[str, Any]) -> None:
        """Raises an error if a job may not make this API call.

        Args:
            arn: The job.
            shape: The operation.
            members: The members of the request on the wire, which have been checked.

        Raises:
            AccessDeniedException: A job may not make this call; the message is the same whether or not the resource
                exists.
            ResourceNotFoundException: The job is not in the catalog any more.
        """
        job = self._service.catalog.get(arn, kind="simulation-job")
        named = set(named_resources(members))
        if shape.name in _OF_ITSELF and named <= {arn} and named:
            return
        own = SimulationJobDocument.of(job).request
        if shape.name in _OF_WHAT_IT_USES and named <= set(named_resources(own)):
            return
        if shape.name == _CREATE and self._service.settings.jobs_create_jobs:
            self._check_created(job, own, members)
            return
        why = "the setting ROBOMAKER_JOBS_CREATE_JOBS is 0" if shape.name == _CREATE else "it is not among these"
        raise AccessDeniedException(
            f"{shape.name}: the job {job.id} sent this request, and a job may describe, cancel and tag itself, and "
            f"read what its request names; {why}"
        )

    def _check_created(self, job: Resource, own: Mapping[str, Any], members: Mapping[str, Any]) -> None:
        """Checks that a job creates only jobs like itself: same role, applications, inputs and outputs.

        Raises AccessDeniedException, which names the member, if the new job's request has anything else.
        """
        for what, given, allowed in self._compared(own, members):
            if given not in allowed:
                raise AccessDeniedException(
                    f"{what}: the job {job.id} makes this job, which may have what the job's own request has"
                )

    def _compared(
        self, own: Mapping[str, Any], members: Mapping[str, Any]
    ) -> Iterator[tuple[str, object, list[object]]]:
        """Yields members of a job's request that could exceed its maker's rights: name, value, allowed values."""
        yield "iamRole", members.get("iamRole"), [own.get("iamRole")]
        for role in _ROLES:
            # The same application may run, in the same box or under the same engine, with another launch.
            allowed = [_application(each) for each in own.get(role) or []]
            for index, each in enumerate(members.get(role) or []):
                yield f"{role}[{index}].application", _application(each), allowed
        for world in _worlds(members):
            yield "worldConfigs", world, list(_worlds(own))
        if self._service.settings.roles_file is None:  # no role says what is read and written
            yield "outputLocation", members.get("outputLocation"), [own.get("outputLocation"), None]
            for index, each in enumerate(members.get("dataSources") or []):
                yield f"dataSources[{index}]", _place(each), [_place(each) for each in own.get("dataSources") or []]


def _application(config: Mapping[str, Any]) -> object:
    return config.get("application"), config.get("applicationVersion")


def _place(source: Mapping[str, Any]) -> object:
    return source.get("type"), source.get("s3Bucket"), source.get("s3Keys")


def _worlds(request: Mapping[str, Any]) -> Iterator[object]:
    for role in _ROLES:
        for config in request.get(role) or []:
            for world in config.get("worldConfigs") or []:
                yield world.get("world")
