"""The product's rollout as the service that simulated robots poll."""

from prefect_robomaker.schemas.fleet.rollouts.rollout import Offered, Rollout, RolloutEvent
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import PlannedRobot, RolloutPlan
from prefect_robomaker.tasks.fleet.rollout.ledger import Ledger, begin

WORDS = {"offered": "asked", "fetched": "working", "canceling": "told to stop", "refused": "goes on"}


def plan_of(names: list[str], *, unfit: set[str] | None = None, **members: object) -> RolloutPlan:
    """The plan of a rollout to robots of these names."""
    robots = tuple(
        PlannedRobot(arn=name, unfit_code="MissingRobotApplicationArchitecture" if name in (unfit or ()) else None)
        for name in names
    )
    return RolloutPlan.model_validate({"robots": robots, **members})


def cancellations(rollout: Rollout) -> dict[str, int]:
    """The orders that robots are to be told to give up, by robot, as `order_keeping` reads them from a rollout."""
    numbers = {
        arn: state.earlier_action_id or (state.action_id if state.order == "canceling" else None)
        for arn, state in rollout.robots.items()
    }
    return {arn: number for arn, number in numbers.items() if number is not None}


def advance(rollout: Rollout, event: RolloutEvent | None, now_s: float) -> Rollout:
    """A stored rollout after one event, or after time passed."""
    ledger = Ledger(rollout)
    if event is None:
        ledger.pass_time(now_s)
    else:
        ledger.apply(event, now_s)
    return ledger.rollout()


class LedgerService:
    """A ledger, which may be stored and read again in between."""

    def __init__(self, plan: RolloutPlan, now_s: float, stored_every: int | None = None) -> None:
        """Begins a rollout.

        Args:
            plan: Its plan.
            now_s: When.
            stored_every: After how many events it is stored as JSON and read again; nothing: never.
        """
        self.ledger = Ledger(begin(plan, now_s))
        self._every, self._events = stored_every, 0
        self.most_open = 0

    def tick(self, now_s: float) -> None:
        self.ledger.pass_time(now_s)

    def shown(self) -> dict[str, tuple[str, int]]:
        rollout = self.ledger.rollout()
        robots = rollout.robots
        orders = {
            arn: ("order", s.action_id)
            for arn, s in robots.items()
            if s.action_id and (s.order in ("fetched", "refused") or (s.order == "offered" and not rollout.held))
        }
        return {**orders, **{arn: ("cancel", number) for arn, number in cancellations(rollout).items()}}

    def report(self, event: RolloutEvent, now_s: float) -> None:
        self.ledger.apply(event, now_s)
        self.most_open = max(self.most_open, self.ledger.open_orders)
        self._events += 1
        if self._every and self._events % self._every == 0:
            self.ledger = Ledger(Rollout.of_json(self.ledger.rollout().to_json()))

    def turns(self) -> tuple[str, ...]:
        return self.ledger.offers()

    def offer(self, robot: str, number: int, now_s: float) -> None:
        self.report(Offered(robot=robot, action_id=number), now_s)

    def facts(self) -> dict[str, object]:
        rollout = self.ledger.rollout()
        robots = {
            arn: (WORDS.get(state.order, "nothing"), state.action_id, state.outcome, state.failure_code)
            for arn, state in rollout.robots.items()
        }
        return {"status": rollout.status, "code": rollout.failure_code, "robots": robots}
