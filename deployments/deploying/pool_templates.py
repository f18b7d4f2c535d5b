"""Job templates of work pools: Prefect's own of a type, with what the flows here need as defaults."""

import asyncio
from collections.abc import Mapping
from typing import Any

from prefect.workers.utilities import get_default_base_job_template_for_infrastructure_type

from ...schemas.wire.errors import ConfigurationError
from .job_variables import check_image

TYPES = ("process", "docker", "kubernetes")
_ENVIRONMENT = {
    # A run whose machine dies says nothing more; Prefect's own default, 180 s, tells of that late. 30 is the least.
    "PREFECT_FLOWS_HEARTBEAT_FREQUENCY": "30",
    "DO_NOT_TRACK": "1",
}


def pool_template(
    kind: str, *, image: str | None = None, environment: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """A template for `prefect work-pool create --base-job-template`.

    Args:
        kind: the type of the pool, one of `TYPES`.
        image: container image of its runs, which has this package; for docker and kubernetes.
        environment: more variables for its runs.

    Raises:
        ConfigurationError: an image is missing or of no use, or Prefect does not know the type.
    """
    check_image(kind, image)
    template = asyncio.run(get_default_base_job_template_for_infrastructure_type(kind))
    if template is None:
        raise ConfigurationError(
            f"the Prefect server does not say what a pool of type {kind} is made of; `robomaker doctor` tells whether "
            "it answers"
        )
    properties: dict[str, Any] = template["variables"]["properties"]
    properties["env"]["default"] = {**properties["env"].get("default", {}), **_ENVIRONMENT, **(environment or {})}
    if image:
        properties["image"]["default"] = image
    return template
