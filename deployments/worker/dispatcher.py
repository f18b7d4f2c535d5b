"""The job worker that hands jobs to Prefect deployments, for Prefect workers on any machine.

A job's ARN is the idempotency key of its flow run, so that several dispatchers hand it over only once. When a flow run
ends before its job has ended, the dispatcher starts another one, a few times.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.objects import FlowRun, StateType
from prefect.exceptions import ObjectNotFound, PrefectException

from ...schemas.wire.errors import ConfigurationError, ServiceUnavailableException
from ...tasks.catalog import Resource
from ...tasks.execution.claims import run_under_lease
from ...tasks.execution.retry_limit import fail_job
from ...tasks.operations.registry import registry
from ...tasks.service.service import Service
from ..deploying.deployables import deployment_name
from .pools import JobPool
from .prefect_watch import PrefectWatch

MOST_RUNS = 3

_AT_ONCE = 1000
CHECK_S = 10.0
"""How often a run that was handed over is looked at."""
_SILENT_LEASES = 2
"""How many leases long a run may be running without performing its job before it counts as dead."""

_logger = logging.getLogger(__name__)


@dataclass
class _Handed:
    """A job that was handed over."""

    run: UUID
    number: int
    """Which of the job's runs it is, from 1."""

    check_at: float
    silent_since: float | None = None


class Dispatcher:
    """Finds jobs without a lease and starts a Prefect deployment run for each.

    Args:
        service: where the jobs are.
        pools: which jobs; how many at once is for the work pool to limit.
        prefect: watches the server.
        deployment: the name that the deployments have; absent: that of `robomaker deploy --operations`.
        check_s: how often a run that was handed over is looked at.
    """

    def __init__(
        self,
        service: Service,
        pools: Sequence[JobPool],
        prefect: PrefectWatch,
        *,
        deployment: str | None = None,
        check_s: float = CHECK_S,
    ) -> None:
        self._service = service
        self._pools = pools
        self._prefect = prefect
        self._deployment = deployment
        self._check_s = check_s
        self._deployments: dict[str, UUID] = {}
        self._handed: dict[str, _Handed] = {}
        self._trouble = ""

    def prepare(self) -> None:
        """Finds the deployments.

        Raises:
            ConfigurationError: one does not exist.
        """
        missing = []
        with get_client(sync_client=True) as client:
            for pool in self._pools:
                flow = registry()[pool.operation].perform_name
                name = f"{flow}/{self._deployment or deployment_name(flow)}"
                try:
                    self._deployments[pool.kind] = client.read_deployment_by_name(name).id
                except ObjectNotFound:
                    missing.append(name)
                except (httpx.HTTPError, PrefectException) as error:
                    raise ConfigurationError(f"the deployment {name} cannot be looked up: {error}") from error
        if missing:
            raise ConfigurationError(
                f"Prefect has no deployment {', '.join(missing)}; make them with "
                "`robomaker deploy --operations --pool POOL`"
            )

    def look(self) -> None:
        """Hands over jobs without a lease, and checks the flow runs of jobs that were handed over."""
        if not self._prefect.answers:
            return
        try:
            jobs = self._service.catalog.unfinished([pool.kind for pool in self._pools], limit=_AT_ONCE)
            self._forget_all_but({job.arn for job in jobs})
            due = [job for job in jobs if self._is_due(job.arn)]
            if due:
                with get_client(sync_client=True) as client:
                    for job in due:
                        self._see_to(job, client)
        except (httpx.HTTPError, PrefectException, ServiceUnavailableException) as error:
            self._note(f"{type(error).__name__}: {error}")
            self._prefect.look_now()
        else:
            self._note("")

    def status(self) -> dict[str, Any]:
        """Returns the status for the health page."""
        state = "in trouble" if self._trouble else "ready"
        return {
            "state": state if self._prefect.answers else "waiting for Prefect",
            "prefect": self._prefect.url,
            **({"error": self._trouble} if self._trouble else {}),
            "handedOver": len(self._handed),
        }

    def end(self) -> dict[str, int]:
        """Leaves all jobs to the Prefect workers."""
        return {}

    def _is_due(self, arn: str) -> bool:
        handed = self._handed.get(arn)
        return handed is None or handed.check_at <= time.monotonic()

    def _see_to(self, job: Resource, client: SyncPrefectClient) -> None:
        handed = self._handed.get(job.arn)
        if handed is None:
            handed = self._handed[job.arn] = self._hand_over(job, 1, client)
            if handed.check_at > time.monotonic():
                return
        try:
            run = client.read_flow_run(handed.run)
        except ObjectNotFound:
            self._again(job, handed, "was deleted", client)
            return
        handed.check_at = time.monotonic() + self._check_s
        if run.state is not None and run.state.is_final():
            if run.state.type == StateType.CANCELLED:  # a user cancelled it before a Prefect worker began it
                self._service.catalog.request_cancel(job.arn)
            self._again(job, handed, f"ended as {run.state.name}: {run.state.message}", client)
        elif run.state is not None and run.state.type == StateType.RUNNING:
            handed.silent_since = handed.silent_since or time.monotonic()
            if time.monotonic() - handed.silent_since > _SILENT_LEASES * self._service.timing.lease_s:
                self._again(job, handed, "has gone silent", client)

    def _again(self, job: Resource, handed: _Handed, why: str, client: SyncPrefectClient) -> None:
        """Hands a job over once more, or fails it at the retry limit."""
        if handed.number < MOST_RUNS:
            _logger.warning("%s: its flow run %s; there will be another one", job.id, why)
            self._handed[job.arn] = self._hand_over(job, handed.number + 1, client)
            return
        reason = f"each of {handed.number} flow runs ended before the job did; the last one {why}"
        _logger.error("%s: the job is not tried again: %s", job.id, reason)
        del self._handed[job.arn]
        run_under_lease(job.arn, job.kind, self._service, lambda lease: fail_job(lease, reason, self._service))

    def _hand_over(self, job: Resource, number: int, client: SyncPrefectClient) -> _Handed:
        run: FlowRun = client.create_flow_run_from_deployment(
            self._deployments[job.kind],
            parameters={"arn": job.arn},
            idempotency_key=job.arn if number == 1 else f"{job.arn}#{number}",
            name=job.id,
        )
        # The idempotency key may return a run of another or an earlier dispatcher, which may have ended long ago.
        is_new = run.state is None or run.state.is_scheduled()
        if is_new:
            _logger.info("%s: handed over as flow run %s", job.id, run.id)
        return _Handed(run.id, number, time.monotonic() + (self._check_s if is_new else 0.0))

    def _forget_all_but(self, arns: set[str]) -> None:
        """Forgets jobs that have ended or whose lease is held."""
        for arn in self._handed.keys() - arns:
            del self._handed[arn]

    def _note(self, trouble: str) -> None:
        if trouble and not self._trouble:
            _logger.warning("jobs cannot be handed over: %s", trouble)
        self._trouble = trouble
