"""Real agents at `robomaker serve`: of an application that needs an attestation, only what was attested runs."""

import secrets
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_here import ServeHere
from helpers.fleet_calls import Fleets
from helpers.local_agents import local_agents
from helpers.polling_robot import carried_out
from helpers.processes import wait_for
from helpers.tested_batches import Batches
from helpers.tuf_repository import bundle

from prefect_robomaker.tasks.fleet.fleet_records import enrollable
from prefect_robomaker.tasks.fleet.trust import deployments
from prefect_robomaker.tasks.fleet.trust.ceremonies import AttestedChange, renew_root
from prefect_robomaker.tasks.fleet.trust.enrolment_tokens import offer
from prefect_robomaker.tasks.fleet.trust.publishing import publisher_of
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, pytest.mark.timeout(1200)]

DRIVES = "#!/bin/sh\nexec sleep 1000\n"


class Site:
    """A fleet with one agent."""

    def __init__(self, service: Service) -> None:
        self.service, self.fleets = service, Fleets(service)
        self.fleet = self.fleets.fleet()
        self.fleets.robot("rover", self.fleet)
        self.token = offer(enrollable("rover", service), service, secrets.token_bytes, rotate=False).text
        service.store.ensure_bucket("apps")
        service.store.put_bytes("apps", "1.tar.gz", bundle({"drive": DRIVES}))
        self.application = self.fleets.application("courier", sources=[{"s3Bucket": "apps", "s3Key": "1.tar.gz"}])

    def ended(self, name: str, **members: Any) -> dict[str, Any]:
        """Deploys version 1, and waits for the end."""
        launch = {"launchConfig": {"packageName": "courier", "launchFile": "drive"}}
        order = self.fleets.order(self.fleet, self.application, name, config=launch, **members)
        job = call("CreateDeploymentJob", order, self.service)["arn"]
        with carried_out(job, self.service):
            wait_for(lambda: self._is_over(job), f"the end of {job}", 240)
        return self.fleets.described(job)

    def _is_over(self, job: str) -> bool:
        return self.service.catalog.get(job).status in ("Succeeded", "Failed")


def test_an_agent_runs_only_what_was_attested(
    serve_here: ServeHere, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = Site(service)
    renew_root(publisher_of(service), [], [], None, AttestedChange(add=("courier",)))
    with serve_here(ROBOMAKER_ROBOT_POLL_S="1") as served, local_agents(tmp_path / "robots") as agents:
        agent = agents.start("rover", site.token, served.url)

        refused = site.ended("without")
        assert (refused["status"], refused["failureCode"]) == ("Failed", "MissingRobotDeploymentResource")

        with monkeypatch.context() as taken_over:  # the service's own check is gone, and all keys but two are there
            taken_over.setattr(deployments, "_check_attested", lambda *_, **__: None)
            attacked = site.ended("attack")
        (robot,) = attacked["robotDeploymentSummary"]
        assert (robot["failureCode"], attacked["status"]) == ("RobotDeploymentAborted", "Failed")
        assert "AttestationError: version 1 of courier was not attested" in robot["failureReason"]
        assert agent.version is None

        batch = Batches(service, service.store.head("apps", "1.tar.gz").etag).batch()
        assert site.ended("attested", deploymentConfig={"requiresBatch": batch})["status"] == "Succeeded"
        assert agent.version == "1"
    assert "Traceback" not in served.log.read_text()
