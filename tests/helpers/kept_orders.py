"""Open rollouts as tests write them down, and the table of orders that is kept by them."""

from typing import Any

from helpers.robot_orders import table_of_robots
from prefect_robomaker.schemas.fleet.operations.deployment_jobs import DeploymentLaunchConfig
from prefect_robomaker.schemas.fleet.rollouts.rollout import RobotDeploymentState, Rollout
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import Artifact, PlannedRobot, RolloutPlan
from prefect_robomaker.tasks.fleet.fleet_records import KnownRobots
from prefect_robomaker.tasks.fleet.kept_rollouts import OpenRollout
from prefect_robomaker.tasks.fleet.order_keeping import OrderKeeper

LAUNCH = DeploymentLaunchConfig(packageName="courier", launchFile="drive.launch")
ARTIFACT = Artifact(
    bucket="robomaker",
    key="robots/file.swu",
    file_name="application.swu",
    size_bytes=1000,
    sha256="a" * 64,
    sha1="b" * 40,
    md5="c" * 32,
    name="courier",
    version="3",
)


class NamedRobots(KnownRobots):
    """Robots whose ARNs are their ids with `arn:` before them."""

    def arn(self, robot: str) -> str | None:
        return f"arn:{robot}"

    def id(self, arn: str) -> str | None:
        return arn.removeprefix("arn:")

    def tags(self, robot: str) -> dict[str, str]:
        return {"board": robot}


class Table:
    """A table of robots, and what keeps it."""

    def __init__(self, *robots: str) -> None:
        self.orders = table_of_robots(*robots)
        self.robots = NamedRobots(self.orders)
        self.keeper = OrderKeeper(self.orders, self.robots)

    def sync(self, *rollouts: OpenRollout) -> None:
        self.keeper.sync(rollouts)

    def shown(self) -> dict[str, tuple[str, int]]:
        """What robots are asked for, by id."""
        states = {robot: self.orders.state(robot) for robot in self.orders.open()}
        return {
            robot: ("cancel" if state.is_cancelling else "deploy", state.last_action_id)
            for robot, state in states.items()
        }


def open_rollout(
    job: str = "job",
    status: str = "InProgress",
    *,
    held: bool = False,
    planned: dict[str, Any] | None = None,
    **robots: dict[str, Any],
) -> OpenRollout:
    """A rollout with robots, each by the members of its state; `planned` are further members of its plan."""
    members = tuple(PlannedRobot(arn=f"arn:{robot}") for robot in robots)
    plan = RolloutPlan.model_validate({"robots": members, "concurrent_percentage": 50, **(planned or {})})
    states = {f"arn:{robot}": RobotDeploymentState.model_validate(members) for robot, members in robots.items()}
    rollout = Rollout.model_validate(
        {"plan": plan, "robots": states, "began_s": 0, "now_s": 0, "status": status, "held": held}
    )
    return OpenRollout(job, 1, rollout, dict.fromkeys(states, ARTIFACT), LAUNCH)


def order(action_id: int, state: str = "offered", **members: Any) -> dict[str, Any]:
    """The state of a robot with an order."""
    return {"order": state, "action_id": action_id, **members}
