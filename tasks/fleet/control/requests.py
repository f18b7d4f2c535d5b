"""Checks of a deployment request, made before the job is stored."""

from collections.abc import Sequence

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.documents.fleets import DeploymentJobDocument, RobotDocument
from ....schemas.operations.deployment_jobs import DeploymentConfig
from ....schemas.wire.errors import InvalidParameterException
from ...catalog import Resource


def check_robots(
    document: DeploymentJobDocument, application: Resource, fleet: str, robots: Sequence[Resource]
) -> None:
    """Refuses a deployment that cannot reach a single robot, or whose canaries are not in its fleet.

    Args:
        document: the deployment.
        application: the version of the application.
        fleet: ARN of the fleet.
        robots: those of the fleet.

    Raises:
        InvalidParameterException: the fleet has no robots, none can run the application or be asked the condition, or
            a canary is not among them.
    """
    if not robots:
        raise InvalidParameterException(f"fleet: {fleet} has no robots; register some first")
    documents = [RobotDocument.of(robot) for robot in robots]
    if "downloadConditionFile" in document.deployment_config and not any(each.has_agent for each in documents):
        raise InvalidParameterException(
            f"deploymentConfig.downloadConditionFile: only agents ask it, and no robot of {fleet} has one; "
            "enroll robots with `robomaker robots enroll NAME --agent` first, or leave it out (docs/fleets.md)"
        )
    architectures = {each.architecture for each in documents}
    served = served_architectures(application)
    if served is not None and not architectures & served:
        version = document.deployment_application_configs[0]["applicationVersion"]
        raise InvalidParameterException(
            f"deploymentApplicationConfigs[0]: version {version} of {application.arn} has sources "
            f"for {_listed(served)}, the robots of {fleet} are {_listed(architectures)}; add a source for them"
        )
    if not document.repeats:  # since then, canaries may have left
        _check_canaries(DeploymentConfig.model_validate(document.deployment_config), fleet, robots)


def served_architectures(application: Resource) -> set[str] | None:
    """The architectures that a version of an application has an archive for; nothing: it has one for any."""
    served = {source.architecture for source in ApplicationDocument.of(application).sources or []}
    return None if None in served or not served else {each for each in served if each is not None}


def _check_canaries(config: DeploymentConfig, fleet: str, robots: Sequence[Resource]) -> None:
    known = {robot.arn for robot in robots} | {robot.name for robot in robots}
    for number, canary in enumerate(config.canaryRobots or []):
        if canary not in known:
            raise InvalidParameterException(
                f"deploymentConfig.canaryRobots[{number}]: {canary} is not a robot of {fleet}; name robots of the fleet"
            )


def _listed(words: set[str]) -> str:
    return ", ".join(sorted(words))
