"""Any sequence of calls about fleets, robots and deployments gives what a few dictionaries give."""

import tempfile
from pathlib import Path
from typing import Any

import pytest
from helpers.examples import examples
from helpers.fleet_calls import Fleets
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, rule

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import (
    ConcurrentDeploymentException,
    InvalidParameterException,
    ResourceAlreadyExistsException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.service.service import Service


class FleetMachine(RuleBasedStateMachine):
    """The model: the fleet of each robot, and the deployments of each fleet, oldest first."""

    fleets = Bundle("fleets")
    robots = Bundle("robots")
    jobs = Bundle("jobs")

    @initialize()
    def open(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        home = {"ROBOMAKER_HOME": str(Path(self.folder.name) / "home")}
        self.service = Service.open(Settings.from_environment(home), {})
        self.calls = Fleets(self.service)
        self.application = self.calls.application()
        self.names: dict[str, str] = {}
        self.places: dict[str, str | None] = {}
        self.deployments: dict[str, list[str]] = {}
        self.states: dict[str, str] = {}
        self.orders = 0

    @rule(target=fleets, name=st.sampled_from(["yard", "hall"]))
    def create_fleet(self, name: str) -> str:
        arn = self.calls.fleet(name)
        self.deployments[arn] = []
        return arn

    @rule(target=robots, name=st.sampled_from(["rover", "crane", "truck"]))
    def create_robot(self, name: str) -> str:
        taken = [arn for arn, known in self.names.items() if known == name and arn in self.places]
        if taken:
            with pytest.raises(ResourceAlreadyExistsException):
                self.calls.robot(name)
            return taken[0]
        arn = self.calls.robot(name)
        self.names[arn], self.places[arn] = name, None
        return arn

    @rule(fleet=fleets, robot=robots)
    def register(self, fleet: str, robot: str) -> None:
        if fleet not in self.deployments or robot not in self.places:
            with pytest.raises(ResourceNotFoundException):
                self.calls.register(fleet, robot)
        elif self.places[robot] not in (None, fleet):
            with pytest.raises(InvalidParameterException):
                self.calls.register(fleet, robot)
        else:
            self.calls.register(fleet, robot)
            self.places[robot] = fleet

    @rule(fleet=fleets, robot=robots)
    def deregister(self, fleet: str, robot: str) -> None:
        if fleet not in self.deployments or robot not in self.places:
            with pytest.raises(ResourceNotFoundException):
                self.calls.deregister(fleet, robot)
        elif self.places[robot] not in (None, fleet):
            with pytest.raises(InvalidParameterException):
                self.calls.deregister(fleet, robot)
        else:
            self.calls.deregister(fleet, robot)
            self.places[robot] = None

    @rule(robot=robots)
    def delete_robot(self, robot: str) -> None:
        self.calls.call("DeleteRobot", robot=robot)
        self.places.pop(robot, None)

    @rule(fleet=fleets)
    def delete_fleet(self, fleet: str) -> None:
        self.calls.call("DeleteFleet", fleet=fleet)
        for job in self.deployments.pop(fleet, []):
            if self.states[job] == "Pending":
                self.states[job] = "Failed"
        self.places = {robot: None if place == fleet else place for robot, place in self.places.items()}

    @rule(target=jobs, fleet=fleets, repeats=st.booleans())
    def deploy(self, fleet: str, repeats: bool) -> str:
        self.orders += 1
        token = f"token-{self.orders}"

        def order() -> dict[str, Any]:
            if repeats:
                return self.calls.call("SyncDeploymentJob", fleet=fleet, clientRequestToken=token)
            return self.calls.deploy(fleet, self.application, token)

        if (error := self.refusal(fleet, repeats)) is not None:
            with pytest.raises(error):
                order()
            return ""
        job = order()["arn"]
        assert order()["arn"] == job
        self.deployments[fleet].append(job)
        self.states[job] = "Pending"
        return job

    def refusal(self, fleet: str, repeats: bool) -> type[Exception] | None:
        if fleet not in self.deployments:
            return ResourceNotFoundException
        if repeats and not self.deployments[fleet]:
            return InvalidParameterException
        if any(self.states[job] == "Pending" for job in self.deployments[fleet]):
            return ConcurrentDeploymentException
        return None if fleet in self.places.values() else InvalidParameterException

    @rule(job=jobs)
    def cancel(self, job: str) -> None:
        if job:
            self.calls.cancel(job)
            if self.states[job] == "Pending":
                self.states[job] = "Canceled"

    @invariant()
    def robots_are_where_and_what_the_model_says(self) -> None:
        found = self.calls.call("ListRobots")["robots"]
        assert {robot["arn"]: (robot.get("fleetArn"), robot["status"]) for robot in found} == {
            robot: (fleet, self.status(fleet)) for robot, fleet in self.places.items()
        }

    def status(self, fleet: str | None) -> str:
        if fleet is None:
            return "Available"
        waits = any(self.states[job] == "Pending" for job in self.deployments[fleet])
        return "PendingNewDeployment" if waits else "Registered"

    @invariant()
    def fleets_have_the_robots_and_deployments_of_the_model(self) -> None:
        found = {fleet["arn"]: fleet for fleet in self.calls.call("ListFleets")["fleetDetails"]}
        assert found.keys() == self.deployments.keys()
        for fleet, made in self.deployments.items():
            described = self.calls.described(fleet)
            assert {robot["arn"] for robot in described["robots"]} == {
                robot for robot, place in self.places.items() if place == fleet
            }
            last = (made[-1], self.states[made[-1]]) if made else (None, None)
            for entry in (described, found[fleet]):
                assert (entry.get("lastDeploymentJob"), entry.get("lastDeploymentStatus")) == last

    @invariant()
    def deployments_are_those_of_the_model(self) -> None:
        found = self.calls.call("ListDeploymentJobs")["deploymentJobs"]
        assert {job["arn"]: job["status"] for job in found} == self.states

    def teardown(self) -> None:
        self.service.catalog.close()
        self.folder.cleanup()


class TestFleetMachine(FleetMachine.TestCase):
    settings = examples(10, stateful_step_count=25)
