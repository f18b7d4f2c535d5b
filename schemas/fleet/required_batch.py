"""Simulation job batch that has to pass before a deployment: named in the request's configuration or in a tag."""

from ..operations.registry import agreed
from ..wire.arns import ResourceArn
from ..wire.errors import InvalidParameterException
from .operations.deployment_jobs import CreateDeploymentJobRequest

REQUIRES_BATCH_TAG = "robomaker:requiresBatch"


def required_batch_of(request: CreateDeploymentJobRequest) -> str | None:
    """Returns the ARN of the simulation job batch that a deployment request requires to have passed, or `None`.

    The request names it in its configuration or in a tag.

    Raises:
        InvalidParameterException: The required batch is not the ARN of a batch, or the tag and the configuration name
            different batches.
    """
    member = "deploymentConfig.requiresBatch"
    by_member = request.deploymentConfig.requiresBatch if request.deploymentConfig else None
    tag = (request.tags or {}).get(REQUIRES_BATCH_TAG)
    for place, arn in {member: by_member, f"tags.{REQUIRES_BATCH_TAG}": tag}.items():
        if arn is not None:
            _check_batch_arn(arn, place)
    return by_member if tag is None else agreed(member, REQUIRES_BATCH_TAG, by_member, tag)


def _check_batch_arn(arn: str, place: str) -> None:
    try:
        ResourceArn.parse(arn, "simulation-job-batch")
    except InvalidParameterException as error:
        raise InvalidParameterException(f"{place}: {error}") from None
