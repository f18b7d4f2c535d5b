"""Orders a flow run that resumes an interrupted run of a Prefect deployment."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

import httpx
from prefect.client.schemas.responses import DeploymentResponse
from prefect.exceptions import ObjectNotFound, PrefectException

from ...schemas.reports.run_record import Order
from ...tasks.execution.dead_flow_runs import tell_of_dead
from ...tasks.execution.prefect_settings import asking_once

_logger = logging.getLogger(__name__)


class Continuing:
    """Orders flow runs by which Prefect workers resume interrupted runs.

    Args:
        pools: The work pools whose Prefect workers are known to be there.
    """

    def __init__(self, pools: Sequence[str]) -> None:
        self._pools = pools

    def order(self, order: Order) -> bool:
        """Orders a flow run that resumes an interrupted run, once for each interruption.

        Args:
            order: The run.

        Returns:
            Whether a Prefect worker finishes the run; false: its deployment is gone, or is of another pool, or the
            flow run has ended already.
        """
        if order.deployment is None:
            return False
        name = f"{order.run_id}, continued"
        try:
            with asking_once() as client:
                deployment = client.read_deployment(UUID(order.deployment))
                if deployment.work_pool_name not in self._pools:
                    return False
                made = client.create_flow_run_from_deployment(
                    deployment.id,
                    parameters={**_required(order, deployment), "continues": order.run_id},
                    name=name,
                    idempotency_key=f"{name} {len(order.interruptions) + 1}",
                )
        except ObjectNotFound:
            return False
        except (httpx.HTTPError, PrefectException, RuntimeError) as error:
            _logger.warning("no flow run finishes %s: %s", order.run_id, error)
            return False
        if made.state is not None and made.state.is_final():
            return False
        # The dead run may hold the only place of its deployment, until Prefect knows that it has died.
        if order.flow_run is not None:
            tell_of_dead(order.flow_run, f"its process died; the flow run {name}, finishes it")
        return True


def _required(order: Order, deployment: DeploymentResponse) -> Mapping[str, Any]:
    """Returns values for parameters that Prefect requires, or it refuses the flow run.

    The run itself uses the values in its order.
    """
    required = (deployment.parameter_openapi_schema or {}).get("required", ())
    return {name: order.parameters[name] for name in required if name in order.parameters}
