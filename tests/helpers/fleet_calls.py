"""Calls about fleets, robots and deployments, as a client makes them."""

from dataclasses import dataclass
from typing import Any

from helpers.application_calls import Applications
from prefect_robomaker.schemas.documents.document_base import Changes
from prefect_robomaker.schemas.fleet.documents import DeploymentJobDocument, RobotEnrolment
from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token
from prefect_robomaker.tasks.fleet.fleet_records import robots_of
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

LAUNCH = {"packageName": "my_robot", "launchFile": "drive.launch"}


class _Config(Changes):
    deployment_config: dict[str, Any]


@dataclass(frozen=True)
class Fleets:
    """A service's fleets."""

    service: Service

    def call(self, operation: str, /, **members: Any) -> dict[str, Any]:
        return call(operation, members, self.service)

    def fleet(self, name: str = "yard", **members: Any) -> str:
        """Makes a fleet and returns its ARN."""
        return self.call("CreateFleet", name=name, **members)["arn"]

    def robot(self, name: str = "rover", fleet: str | None = None, **members: Any) -> str:
        """Makes a robot, in a fleet if one is given, and returns its ARN."""
        request = {"architecture": "X86_64", "greengrassGroupId": "group-1", **members}
        arn = self.call("CreateRobot", name=name, **request)["arn"]
        if fleet is not None:
            self.register(fleet, arn)
        return arn

    def register(self, fleet: str, robot: str) -> None:
        assert self.call("RegisterRobot", fleet=fleet, robot=robot) == {"fleet": fleet, "robot": robot}

    def deregister(self, fleet: str, robot: str) -> None:
        assert self.call("DeregisterRobot", fleet=fleet, robot=robot) == {"fleet": fleet, "robot": robot}

    def described(self, arn: str) -> dict[str, Any]:
        """What is said of the robot, fleet or deployment job of an ARN."""
        kind = arn.split(":")[5].partition("/")[0]
        operation, member = {
            "robot": ("DescribeRobot", "robot"),
            "deployment-fleet": ("DescribeFleet", "fleet"),
            "deployment-job": ("DescribeDeploymentJob", "job"),
        }[kind]
        return self.call(operation, **{member: arn})

    def members(self, fleet: str) -> list[str]:
        """Names of a fleet's robots."""
        return [robot["name"] for robot in self.described(fleet)["robots"]]

    def application(self, name: str = "mine", **members: Any) -> str:
        """Makes a robot application of one version and returns its ARN."""
        applications = Applications.of("Robot", self.service)
        arn = applications.create(name, **members)["arn"]
        applications.version(arn)
        return arn

    def order(self, fleet: str, application: str, token: str = "once", **members: Any) -> dict[str, Any]:
        """A request for a deployment."""
        config = {"application": application, "applicationVersion": "1", "launchConfig": LAUNCH}
        return {
            "fleet": fleet,
            "clientRequestToken": token,
            "deploymentApplicationConfigs": [{**config, **members.pop("config", {})}],
            **members,
        }

    def deploy(self, fleet: str, application: str, token: str = "once", **members: Any) -> dict[str, Any]:
        return self.call("CreateDeploymentJob", **self.order(fleet, application, token, **members))

    def cancel(self, job: str) -> None:
        assert self.call("CancelDeploymentJob", job=job) == {}

    def let_agents_in(self, fleet: str) -> None:
        """Makes all robots of a fleet such with an agent, as if they had enrolled."""
        for robot in robots_of(fleet, self.service):
            enrolment = RobotEnrolment(kind="agent", token_sha256=hash_token(robot.name).hex())
            self.service.catalog.update(robot.arn, enrolment)

    def give_condition(self, job: str, file: dict[str, str]) -> None:
        """Gives a job a download condition, as it may have been stored by an older release."""
        config = DeploymentJobDocument.of(self.service.catalog.get(job)).deployment_config
        self.service.catalog.update(job, _Config(deployment_config={**config, "downloadConditionFile": file}))
