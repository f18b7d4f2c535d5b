"""When a rollout ends: counts of robots, kept up to date one robot at a time, and what follows from them."""

from dataclasses import dataclass, field

from ....schemas.operations.deployment_jobs import DeploymentJobErrorCode
from ....schemas.rollouts.plan import RolloutPlan
from ....schemas.rollouts.robots import RobotDeploymentState
from ....schemas.rollouts.rollout import RolloutStatus


@dataclass(frozen=True)
class Verdict:
    """How a rollout ends."""

    status: RolloutStatus
    code: DeploymentJobErrorCode | None = None
    reason: str | None = None


@dataclass
class Group:
    """Counts of the robots of a fleet, or of its canaries, that take part.

    Robots that cannot get the application, and robots that left before they ended, do not take part.
    """

    name: str
    robots: int = 0
    ended: int = 0
    failed: int = 0

    def count(self, state: RobotDeploymentState, sign: int) -> None:
        """Counts a robot in, or out again."""
        if state.gone is not None and state.outcome is None:
            return
        self.robots += sign
        self.ended += sign * state.has_ended
        self.failed += sign * (state.outcome == "failed")

    @property
    def has_ended(self) -> bool:
        """Whether each robot has."""
        return self.ended == self.robots

    def breach(self, threshold_percentage: int) -> str | None:
        """How many robots failed if these are too many, in words."""
        if not self.failed or self.failed * 100 < threshold_percentage * self.robots:
            return None
        share = 100 * self.failed / self.robots
        return (
            f"{self.failed} of {self.robots} {self.name} failed, which is {share:.3g} %; "
            f"the threshold is {threshold_percentage} %"
        )


@dataclass
class Tally:
    """Counts of a rollout's robots."""

    plan: RolloutPlan
    fleet: Group = field(default_factory=lambda: Group("robots"))
    canaries: Group = field(default_factory=lambda: Group("canaries"))
    open: int = 0

    def __post_init__(self) -> None:
        self._unfit = {robot.arn: robot for robot in self.plan.robots if robot.unfit_code is not None}
        self._canaries = frozenset(self.plan.canaries)

    def count(self, robot: str, state: RobotDeploymentState, sign: int) -> None:
        """Counts a robot in (`sign` 1), or out again (-1)."""
        self.open += sign * state.is_open
        if robot in self._unfit:
            return
        self.fleet.count(state, sign)
        if robot in self._canaries:
            self.canaries.count(state, sign)

    def verdict(self) -> Verdict | None:
        """How the rollout ends now; nothing: it goes on."""
        for group in (self.canaries, self.fleet):
            if reason := group.breach(self.plan.threshold_percentage):
                return Verdict("Failed", "FailureThresholdBreached", reason)
        if not self.fleet.robots:
            unfit = next(iter(self._unfit.values()), None)
            if unfit is not None:
                return Verdict("Failed", unfit.unfit_code, "no robot that is left can get the application")
            return Verdict("Failed", "RobotDeploymentAborted", "each robot left the fleet before its turn ended")
        return Verdict("Succeeded") if self.fleet.has_ended else None
