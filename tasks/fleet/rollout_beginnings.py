"""Starts the rollout of a deployment job: makes its plan, and takes over unanswered orders of earlier rollouts.

A robot with an order that it has not answered first gets the cancellation of that order. The new rollout waits for the
answer, and the earlier one no longer does.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from ...schemas.documents.document_base import StoredResource
from ...schemas.fleet.documents import DeploymentJobDocument, RobotDocument
from ...schemas.fleet.operations.deployment_jobs import (
    DEFAULT_ROBOT_TIMEOUT_S,
    DeploymentApplicationConfig,
    DeploymentConfig,
)
from ...schemas.fleet.rollouts.rollout import Canceled, Stopped
from ...schemas.fleet.rollouts.rollout_plan import (
    DEFAULT_CONCURRENT_PERCENTAGE,
    DEFAULT_THRESHOLD_PERCENTAGE,
    Artifact,
    Delivery,
    PlannedRobot,
    RolloutPlan,
)
from ...schemas.wire.arns import ResourceArn
from ..catalog import Resource
from ..service.service import Service
from .catalog_rollouts import Rollouts
from .kept_rollouts import KeptRollout
from .rollout.ledger import begin


@dataclass(frozen=True)
class Prepared:
    """Installation files that were made for a deployment, by processor architecture."""

    for_updaters: Mapping[str, Artifact]
    for_agents: Mapping[str, Artifact]

    def of(self, robot: Resource) -> Artifact | None:
        """Returns the installation file for a robot; `None` if there is none for its architecture."""
        document = RobotDocument.of(robot)
        return (self.for_agents if document.has_agent else self.for_updaters).get(document.architecture)

    def has(self, robot: Resource) -> bool:
        """Whether there is an installation file for a robot's architecture."""
        return self.of(robot) is not None


def plan_of(job: StoredResource, robots: Iterable[Resource], has_file: Callable[[Resource], bool]) -> RolloutPlan:
    """Makes the plan of a deployment: its robots in order and its limits.

    Args:
        job: The deployment job.
        robots: ARNs of the robots to deploy to, in the order of the rollout.
        has_file: Whether there is a file for a robot; those without one fail.
    """
    document = DeploymentJobDocument.of(job)
    config = DeploymentConfig.model_validate(document.deployment_config)
    members = list(robots)
    planned = tuple(_planned(robot, document, has_file(robot)) for robot in members)
    return RolloutPlan(
        robots=planned,
        canaries=_canaries(config, members, planned),
        requires_approval=config.requiresApproval or False,
        windows=tuple(config.maintenanceWindows or ()),
        rolls_back=config.onThresholdBreached == "ROLLBACK",
        # Jobs from before deployments acted have no percentages.
        concurrent_percentage=config.concurrentDeploymentPercentage or DEFAULT_CONCURRENT_PERCENTAGE,
        threshold_percentage=config.failureThresholdPercentage or DEFAULT_THRESHOLD_PERCENTAGE,
        robot_timeout_s=config.robotDeploymentTimeoutInSeconds or DEFAULT_ROBOT_TIMEOUT_S,
    )


def _planned(robot: Resource, job: DeploymentJobDocument, has_file: bool) -> PlannedRobot:
    known = RobotDocument.of(robot)
    planned = PlannedRobot(arn=robot.arn, installed=known.installed)
    if "downloadConditionFile" in job.deployment_config and not known.has_agent:
        reason = "only agents ask the downloadConditionFile, and this robot has another updater (docs/fleet/fleets.md)"
        return planned.model_copy(update={"unfit_code": "DownloadConditionFailed", "unfit_reason": reason})
    (application,) = job.deployment_application_configs
    version = str(application["applicationVersion"])
    if not has_file:
        reason = (
            f"version {version} of the application has no source for {known.architecture}; add one in another version"
        )
        return planned.model_copy(update={"unfit_code": "MissingRobotApplicationArchitecture", "unfit_reason": reason})
    has_it = (known.installed_name, known.installed_version) == (
        ResourceArn.parse(application["application"]).name,
        version,
    )
    return planned if has_it else planned.model_copy(update={"earlier_job": known.installed_by})


def _canaries(config: DeploymentConfig, robots: Sequence[Resource], planned: Sequence[PlannedRobot]) -> tuple[str, ...]:
    """Returns the canaries, robots that get their orders first, without unfit ones and those that left the fleet."""
    fit = [robot.arn for robot in planned if robot.unfit_code is None]
    if config.canaryPercentage is not None:
        return tuple(fit[: max(1, len(planned) * config.canaryPercentage // 100)])
    arns = {robot.name: robot.arn for robot in robots}
    named = (arns.get(canary, canary) for canary in config.canaryRobots or [])
    return tuple(dict.fromkeys(arn for arn in named if arn in frozenset(fit)))


def delivery(job: Resource, robots: Iterable[Resource], prepared: Prepared) -> Delivery:
    """Selects the installation files that each robot of a deployment downloads."""
    (config,) = DeploymentJobDocument.of(job).deployment_application_configs
    served = {robot.arn: RobotDocument.of(robot) for robot in robots if prepared.has(robot)}
    return Delivery(
        artifacts=dict(prepared.for_updaters),
        agent_artifacts=dict(prepared.for_agents),
        agents=frozenset(arn for arn, document in served.items() if document.has_agent),
        architectures={arn: document.architecture for arn, document in served.items()},
        launch=DeploymentApplicationConfig.model_validate(config).launchConfig,
    )


def begin_rollout(job: Resource, plan: RolloutPlan, gets: Delivery, service: Service) -> KeptRollout:
    """Starts the rollout (deployment to robots) of a job, or finds it started; it takes over unanswered orders.

    Args:
        job: The deployment job.
        plan: The rollout's plan.
        gets: The files that robots get.
        service: The service, with its catalog and object store.
    """
    earlier = _end_earlier(job, gets.architectures, service)
    rollout = begin(plan, service.clock().timestamp(), earlier)
    is_new = Rollouts(service.catalog).begin_rollout(job.arn, gets.to_json(), rollout.to_json())
    kept = KeptRollout(job, service)
    taken = {arn: state.earlier_action_id for arn, state in kept.rollout.robots.items() if state.earlier_action_id}
    Rollouts(service.catalog).move_orders(list(taken.values()), job.arn)
    for other in _others(job, service):
        answered = other.give_away(taken)
        if is_new and answered:  # between the reading of it and the moving
            kept.fold(*(Canceled(robot=robot, action_id=taken[robot]) for robot in answered))
    return kept


def _end_earlier(job: Resource, robots: Collection[str], service: Service) -> dict[str, int]:
    """Ends earlier rollouts of the fleet; returns the number of the order that each robot has not answered."""
    unanswered: dict[str, int] = {}
    for other in _others(job, service):
        other.fold(*([Stopped(why="superseded")] if other.job.parent == job.parent else []))
        unanswered |= other.unanswered()
    meant = frozenset(robots)
    return {robot: number for robot, number in unanswered.items() if robot in meant}


def _others(job: Resource, service: Service) -> list[KeptRollout]:
    """Returns the open rollouts of other deployment jobs of the fleet."""
    arns = [arn for arn in Rollouts(service.catalog).open_rollouts() if arn != job.arn]
    found = service.catalog.get_many(arns)
    return [KeptRollout(found[arn], service) for arn in arns if arn in found]
