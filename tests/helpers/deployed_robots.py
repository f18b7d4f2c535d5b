"""Robots that carry out deployments in simulated time, by what the door for robots reads and reports."""

import io
import tarfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import Any

from helpers.fleet_calls import Fleets
from prefect_robomaker.schemas.fleet.rollouts.rollout import Canceled, Failed, Fetched, Progressed, Report, Succeeded
from prefect_robomaker.tasks.execution.leases.leased_runs import run_under_lease
from prefect_robomaker.tasks.fleet.deployment_runs import DeploymentRun
from prefect_robomaker.tasks.fleet.kept_rollouts import report, served_rollouts
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Behaviour = Callable[["Yard", str, str, int], None]
"""What a robot does with an open order: the yard, the job, the robot's ARN, the order's number."""


def archive() -> bytes:
    """A small application."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        tar.addfile(tarfile.TarInfo("launch"), io.BytesIO())
    return buffer.getvalue()


def deployable(fleets: Fleets, *architectures: str, name: str = "mine") -> str:
    """Makes a robot application with an archive for each architecture, and returns its ARN."""
    store = fleets.service.store
    store.ensure_bucket("apps")
    sources = [{"s3Bucket": "apps", "s3Key": f"{each}.tar.gz", "architecture": each} for each in architectures]
    for source in sources:
        store.put_bytes("apps", source["s3Key"], archive())
    return fleets.application(name, sources=sources)


@dataclass
class Yard:
    """A fleet whose robots act whenever the run of a deployment sleeps."""

    plain: Service
    now: datetime = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    behaviours: dict[str, Behaviour] = field(default_factory=dict)
    looks: int = 0
    at_look: dict[int, Callable[[], object]] = field(default_factory=dict)
    most_open: int = 0
    offered: list[str] = field(default_factory=list)
    _done: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.service = replace(self.plain, clock=lambda: self.now)
        self.fleets = Fleets(self.service)
        self.arn = self.fleets.fleet()

    def robot(self, name: str, behaviour: Behaviour, **members: Any) -> str:
        arn = self.fleets.robot(name, self.arn, **members)
        self.behaviours[arn] = behaviour
        return arn

    def sleep(self, duration_s: float) -> None:
        """Lets time pass, and each robot with an order do something."""
        self.now += timedelta(seconds=duration_s)
        self.looks += 1
        self.at_look.get(self.looks, lambda: None)()
        self.act()

    def stride(self, _: float) -> None:
        """Lets more time pass than the run asks for, where a test has minutes to wait for."""
        self.sleep(5.0)

    def act(self) -> None:
        for each in served_rollouts(self.service):
            states = each.rollout.robots
            self.most_open = max(self.most_open, sum(state.is_open for state in states.values()))
            for robot, state in states.items():
                number = state.earlier_action_id or state.action_id
                if number is None or state.order == "closed" or robot not in self.behaviours:
                    continue
                if state.order == "offered" and each.rollout.held:
                    continue  # it is not shown the order
                if state.earlier_action_id or state.order == "canceling":
                    if self.behaviours[robot] is not silent:
                        self.say(each.job, Canceled(robot=robot, action_id=number))
                else:
                    assert robot in each.artifacts
                    self.behaviours[robot](self, each.job, robot, number)
        served_rollouts(self.service)

    def turn(self, number: int) -> int:
        """How often the robot has acted on an order before."""
        self._done[number] = self._done.get(number, -1) + 1
        return self._done[number]

    def say(self, job: str, event: Report) -> None:
        report(self.service, job, event, self.now.timestamp())

    def run(self, job: str, sleep: Callable[[float], None] | None = None) -> dict[str, Any]:
        """Carries a job to its end, and describes it."""
        run_under_lease(
            job,
            "deployment-job",
            self.service,
            lambda lease: DeploymentRun(lease, self.service, sleep or self.sleep).run(),
        )
        return call("DescribeDeploymentJob", {"job": job}, self.service)

    def statuses(self) -> dict[str, str]:
        """The robots' statuses, by name."""
        return {robot["name"]: robot["status"] for robot in self.fleets.described(self.arn)["robots"]}


@contextmanager
def living(service: Service) -> Iterator[Yard]:
    """A fleet whose robots act all the time, in real time."""
    yard, stopped = Yard(service), threading.Event()
    yard.service = replace(service, clock=lambda: datetime.now(UTC))

    def live() -> None:
        while not stopped.wait(0.05):
            yard.now = datetime.now(UTC)
            yard.act()

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield yard
    finally:
        stopped.set()
        thread.join()


def good(yard: Yard, job: str, robot: str, number: int) -> None:
    """Fetches its order, downloads, and succeeds."""
    turn = yard.turn(number)
    if turn == 0:
        yard.offered.append(robot)
        yard.say(job, Fetched(robot=robot, action_id=number))
    elif turn < 4:
        step = Progressed(robot=robot, action_id=number, step="DownloadingExtracting", percent_done=25.0 * turn)
        yard.say(job, step)
    else:
        yard.say(job, Succeeded(robot=robot, action_id=number))


def bad(yard: Yard, job: str, robot: str, number: int) -> None:
    """Fetches its order, and fails."""
    if yard.turn(number) == 0:
        yard.offered.append(robot)
        yard.say(job, Fetched(robot=robot, action_id=number))
    else:
        yard.say(job, Failed(robot=robot, action_id=number, code="PreLaunchFileFailure", reason="no arm"))


def slow(yard: Yard, job: str, robot: str, number: int) -> None:
    """Fetches its order, and never ends."""
    if yard.turn(number) == 0:
        yard.say(job, Fetched(robot=robot, action_id=number))


def silent(*_: object) -> None:
    """Is away."""
