"""Robots at `robomaker serve`: orders of deployments, and nothing but their own."""

import hashlib
import secrets
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest
from helpers.deployed_robots import deployable
from helpers.endpoint_here import ServeHere
from helpers.fleet_calls import Fleets
from helpers.polling_robot import PollingRobot, artifact_of, carried_out
from helpers.processes import wait_for

from prefect_robomaker.schemas.fleet.documents import RobotDocument
from prefect_robomaker.tasks.fleet.fleet_records import enrol
from prefect_robomaker.tasks.service.service import Service

ALL_AT_ONCE = {"concurrentDeploymentPercentage": 100, "failureThresholdPercentage": 100}


class Site:
    """A fleet with enrolled robots."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.fleets = Fleets(service)
        self.fleet = self.fleets.fleet()
        self.application = deployable(self.fleets, "X86_64")
        self.arns: dict[str, str] = {}
        self.tokens: dict[str, str] = {}

    def enrol(self, *names: str) -> None:
        for name in names:
            self.arns[name] = self.fleets.robot(name, self.fleet)
            self.tokens[name] = enrol(name, self.service, secrets.token_bytes, rotate=False)

    def robot(self, name: str, url: str) -> PollingRobot:
        robot = PollingRobot(url, name, self.tokens[name])
        wait_for(lambda: robot.poll_status() == 200, f"{name} to be let in")
        return robot

    def deploy(self, token: str = "once") -> str:
        return self.fleets.deploy(self.fleet, self.application, token, deploymentConfig=ALL_AT_ONCE)["arn"]

    def summary(self, job: str) -> dict[str, tuple[str | None, str | None, str | None]]:
        """Status, failure code and reason of each robot."""
        found = self.fleets.described(job)["robotDeploymentSummary"]
        return {
            each["arn"].split("/")[1]: (each["status"], each.get("failureCode"), each.get("failureReason"))
            for each in found
        }

    def document(self, name: str) -> RobotDocument:
        return RobotDocument.of(self.service.catalog.get(self.arns[name]))


@pytest.fixture
def site(service: Service) -> Site:
    return Site(service)


def test_robots_get_orders_and_files_and_their_answers_decide(serve_here: ServeHere, site: Site) -> None:
    site.enrol("good", "broken", "liar")
    with serve_here() as served:
        good, broken, liar = (site.robot(name, served.url) for name in ("good", "broken", "liar"))
        good.describe_itself(board="demo")
        job = site.deploy()
        with carried_out(job, site.service):
            order = good.fetch_order()
            file = good.download(order)
            assert hashlib.sha256(file).hexdigest() == artifact_of(order)["hashes"]["sha256"]
            assert len(file) == artifact_of(order)["size"]
            assert good.say_of(order, "proceeding", "none", "Installed Chunk.") == 200
            wait_for(lambda: site.summary(job)["good"][0] == "Deploying", "the progress")
            assert good.say_of(order, "closed", "success", "health ok") == 200

            failed = broken.fetch_order()
            broken.say_of(failed, "proceeding", "none", "ERROR : no space left")
            broken.say_of(failed, "closed", "failure", "No suitable .swu image found")
            liar.say_of(liar.fetch_order(), "closed", "success", "Skipped Update.")
        assert good.links().keys() == set()

    assert site.summary(job) == {
        "good": ("InSync", None, None),
        "broken": ("Failed", "ExtractingBundleFailure", "no space left"),
        "liar": (
            "Failed",
            "RobotDeploymentAborted",
            "the robot closed its order as a success and had installed nothing (Skipped Update.)",
        ),
    }
    told = site.document("good")
    assert (told.installed_name, told.installed_version, told.attributes) == ("mine", "1", {"board": "demo"})
    assert told.last_seen_s is not None
    assert "Traceback" not in served.log.read_text()


@pytest.mark.deep
def test_a_robot_is_asked_to_give_up_until_it_has_answered_also_by_the_next_server(
    serve_here: ServeHere, site: Site
) -> None:
    site.enrol("rover")
    job = site.deploy()
    with serve_here() as served, carried_out(job, site.service):
        rover = site.robot("rover", served.url)
        order = rover.fetch_order()
        served.call("CancelDeploymentJob", {"job": job})
        assert rover.wait_for_link("cancelAction").endswith(order["id"])
    assert site.fleets.described(job)["status"] == "Canceled"

    after = site.deploy("again")
    with serve_here() as served, carried_out(after, site.service):
        rover = site.robot("rover", served.url)
        cancellation = rover.wait_for_link("cancelAction")
        assert cancellation.endswith(order["id"]), "the order of the first deployment comes first"
        assert rover.say(cancellation, "closed", "success") == 200
        order = rover.fetch_order()
        assert not cancellation.endswith(order["id"])
        rover.say_of(order, "proceeding")
        rover.say_of(order, "closed", "success")
    assert site.summary(after)["rover"][0] == "InSync"


@pytest.mark.deep
def test_a_robot_that_refuses_to_give_up_carries_on(serve_here: ServeHere, site: Site) -> None:
    site.enrol("rover")
    job = site.deploy()
    with serve_here() as served:
        rover = site.robot("rover", served.url)
        with carried_out(job, site.service):
            order = rover.fetch_order()
            rover.say_of(order, "proceeding")
            site.fleets.cancel(job)
            assert rover.say(rover.wait_for_link("cancelAction"), "rejected") == 200
        assert rover.wait_for_link("deploymentBase").endswith(order["id"])
        assert rover.say_of(order, "closed", "success") == 200
        wait_for(lambda: site.summary(job)["rover"][0] == "InSync", "what it did all the same")


def test_tokens_are_the_robots_own_and_end_with_them(serve_here: ServeHere, site: Site, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    keys.write_text("[me]\naws_access_key_id = AKIDEXAMPLE\naws_secret_access_key = secret\n")
    keys.chmod(0o600)
    site.enrol("rover", "other")
    with serve_here(ROBOMAKER_ACCESS_KEYS_FILE=str(keys)) as served:
        rover, other = site.robot("rover", served.url), site.robot("other", served.url)
        assert PollingRobot(served.url, "rover", other.token).poll_status() == 401
        with pytest.raises(HTTPError) as refused, urlopen(f"{served.url}/listRobots", b"{}"):
            pass
        assert refused.value.code == 403, "a robot's token opens nothing else"

        token = enrol("rover", site.service, secrets.token_bytes, rotate=True)
        site.fleets.call("DeleteRobot", robot=site.arns["other"])

        wait_for(lambda: PollingRobot(served.url, "rover", token).poll_status() == 200, "the new token")
        assert rover.poll_status() == 401
        assert other.poll_status() == 401
