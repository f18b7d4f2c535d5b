"""Rollouts of a few robots, driven by hand: offers what is due, and says what robots do."""

from helpers.rollout_ledger import cancellations, plan_of
from prefect_robomaker.schemas.fleet.operations.deployment_jobs import RobotDeploymentStep
from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Canceled,
    CancelRefused,
    Failed,
    Fetched,
    Offered,
    Progressed,
    ReportedCode,
    RobotDeploymentState,
    Rollout,
    RolloutEvent,
    Succeeded,
)
from prefect_robomaker.tasks.fleet.rollout.ledger import Ledger, begin
from prefect_robomaker.tasks.fleet.rollout.statuses import robot_status


class SmallRollout:
    """A rollout to robots `r0`, `r1`, ... with a time-out of 100 s each; its clock begins at 1000 s."""

    def __init__(self, robots: int, *, name: str = "r", earlier: dict[str, int] | None = None, **plan: object) -> None:
        names = [f"{name}{number}" for number in range(robots)]
        members = {"robot_timeout_s": 100, "concurrent_percentage": 100, "threshold_percentage": 100, **plan}
        self.ledger = Ledger(begin(plan_of(names, **members), 1000, earlier))
        self.now_s = 1000.0
        self._numbers = 0

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.ledger.pass_time(self.now_s)

    def happen(self, *events: RolloutEvent) -> None:
        for event in events:
            self.ledger.apply(event, self.now_s)

    def offer(self) -> list[str]:
        """Gives an order to each robot whose turn it is."""
        robots = list(self.ledger.offers())
        for robot in robots:
            self._numbers += 1
            self.happen(Offered(robot=robot, action_id=self._numbers))
        return robots

    def number(self, robot: str) -> int:
        """The number of a robot's latest order."""
        number = self.robot(robot).action_id
        assert number is not None
        return number

    def fetch(self, *robots: str) -> None:
        self.happen(*(Fetched(robot=robot, action_id=self.number(robot)) for robot in robots))

    def progress(self, robot: str, step: RobotDeploymentStep, percent_done: float | None = None) -> None:
        number = self.number(robot)
        self.happen(Progressed(robot=robot, action_id=number, step=step, percent_done=percent_done))

    def succeed(self, *robots: str) -> None:
        self.happen(*(Succeeded(robot=robot, action_id=self.number(robot)) for robot in robots))

    def fail(self, robot: str, code: ReportedCode = "PreLaunchFileFailure") -> None:
        self.happen(Failed(robot=robot, action_id=self.number(robot), code=code, reason="exit code 3"))

    def give_up(self, robot: str) -> None:
        self.happen(Canceled(robot=robot, action_id=self.number(robot)))

    def refuse(self, robot: str) -> None:
        self.happen(CancelRefused(robot=robot, action_id=self.number(robot)))

    def robot(self, robot: str) -> RobotDeploymentState:
        return self.ledger.robot(robot)

    def shown(self, robot: str) -> tuple[str | None, str | None]:
        """What a user sees of a robot: status and failure code."""
        state = self.robot(robot)
        return robot_status(state, active=self.rollout.status == "InProgress"), state.failure_code

    def cancellations(self) -> dict[str, int]:
        return cancellations(self.rollout)

    @property
    def rollout(self) -> Rollout:
        return self.ledger.rollout()

    @property
    def end(self) -> tuple[str, str | None]:
        """Status and failure code of the whole."""
        return self.rollout.status, self.rollout.failure_code
