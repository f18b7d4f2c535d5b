"""Failure thresholds of a rollout: how many robots of which group may fail before it ends."""

from dataclasses import dataclass, field

from ....schemas.fleet.operations.deployment_jobs import DeploymentJobErrorCode
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState, RolloutStatus
from ....schemas.fleet.rollouts.rollout_plan import RolloutPlan


@dataclass(frozen=True)
class Verdict:
    """Final result of a deployment to the robots of a fleet: status, and code and reason of a failure."""

    status: RolloutStatus
    code: DeploymentJobErrorCode | None = None
    reason: str | None = None


@dataclass
class Group:
    """Counts of robots by outcome, for a whole fleet or its canary robots.

    Robots that cannot get the application, and robots that left before they ended, do not take part.
    """

    name: str
    robots: int = 0
    ended: int = 0
    failed: int = 0

    def count(self, state: RobotDeploymentState, sign: int) -> None:
        """Adds a robot to the group's counts, or removes it (`sign` -1), unless it left before it finished."""
        if state.gone is not None and state.outcome is None:
            return
        self.robots += sign
        self.ended += sign * state.has_ended
        self.failed += sign * (state.outcome == "failed")

    @property
    def has_ended(self) -> bool:
        """Whether every robot of the group is finished: it installed the application or failed to, or is gone."""
        return self.ended == self.robots

    def breach(self, threshold_percentage: int) -> str | None:
        """Returns a text with the number of failed robots if they reach the threshold, else `None`.

        An example: `3 of 20 robots failed, which is 15 %; the threshold is 10 %`.
        """
        if not self.failed or self.failed * 100 < threshold_percentage * self.robots:
            return None
        share = 100 * self.failed / self.robots
        return (
            f"{self.failed} of {self.robots} {self.name} failed, which is {share:.3g} %; "
            f"the threshold is {threshold_percentage} %"
        )


@dataclass
class Tally:
    """Counts of a deployment's robots by outcome: all of them, and the canary robots, which get it first."""

    plan: RolloutPlan
    fleet: Group = field(default_factory=lambda: Group("robots"))
    canaries: Group = field(default_factory=lambda: Group("canaries"))
    open: int = 0

    def __post_init__(self) -> None:
        self._unfit = {robot.arn: robot for robot in self.plan.robots if robot.unfit_code is not None}
        self._canaries = frozenset(self.plan.canaries)

    def count(self, robot: str, state: RobotDeploymentState, sign: int) -> None:
        """Adds a robot to the counts (`sign` 1), or removes it (-1)."""
        self.open += sign * state.is_open
        if robot in self._unfit:
            return
        self.fleet.count(state, sign)
        if robot in self._canaries:
            self.canaries.count(state, sign)

    def verdict(self) -> Verdict | None:
        """Returns the final result of the deployment to the robots; `None` if it has not ended."""
        for group in (self.canaries, self.fleet):
            if reason := group.breach(self.plan.threshold_percentage):
                return Verdict("Failed", "FailureThresholdBreached", reason)
        if not self.fleet.robots:
            unfit = next(iter(self._unfit.values()), None)
            if unfit is not None:
                return Verdict("Failed", unfit.unfit_code, "no robot that is left can get the application")
            return Verdict("Failed", "RobotDeploymentAborted", "each robot left the fleet before its turn ended")
        return Verdict("Succeeded") if self.fleet.has_ended else None
