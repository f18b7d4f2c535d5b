"""What answers about simulation jobs say of members that the request did not give."""

from typing import Any

import pytest

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobProgress
from prefect_robomaker.schemas.runs.plan import Requirement, RunResult
from prefect_robomaker.schemas.runs.trial_rows import judged_of
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

UPLOAD = {"name": "mine", "path": "/var/log/**", "uploadBehavior": "UPLOAD_ON_TERMINATE"}
OUTPUT = {"outputLocation": {"s3Bucket": "outputs"}}
ROLE = "arn:aws:iam::000000000000:role/any"


def created(service: Service, config: dict[str, Any], **members: Any) -> dict[str, Any]:
    application = {"application": "indoor-navigation", "launchConfig": {}, **config}
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "simulationApplications": [application], **members}
    answer = call("CreateSimulationJob", request, service)
    for described in (
        call("DescribeSimulationJob", {"job": answer["arn"]}, service),
        call("BatchDescribeSimulationJob", {"jobs": [answer["arn"]]}, service)["jobs"][0],
    ):
        assert {name: described[name] for name in answer if name != "lastUpdatedAt"} == {
            name: value for name, value in answer.items() if name != "lastUpdatedAt"
        }
    return answer


def test_the_service_s_defaults_are_told(service: Service) -> None:
    answer = created(service, {})

    assert answer["loggingConfig"] == {"recordAllRosTopics": False}
    application = answer["simulationApplications"][0]
    assert application.pop("application").startswith(
        "arn:aws:robomaker:us-east-1:000000000000:simulation-application/indoor-navigation/"
    )
    assert answer["simulationApplications"] == [
        {
            "applicationVersion": "$LATEST",
            "launchConfig": {},
            "uploadConfigurations": [],
            "useDefaultUploadConfigurations": False,
            "useDefaultTools": False,
        }
    ]
    assert "robotApplications" not in answer


def test_a_built_in_application_takes_no_launch_file_of_an_earlier_one(service: Service) -> None:
    old = {"launchConfig": {"packageName": "hello", "launchFile": "world.launch.py"}}
    with pytest.raises(InvalidParameterException) as refused:
        created(service, old)

    assert str(refused.value) == (
        "simulationApplications[0].launchConfig.packageName: indoor-navigation is built in, and starts without one; "
        "leave out packageName and launchFile, which say what of an archive of your own is started"
    )


RESULT = RunResult(
    verdict="FAIL", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by="environment", seed=1,
    requirements=[
        Requirement(name="met", satisfied=True, detail=""), Requirement(name="missed", satisfied=False, detail=""),
        Requirement(name="broke", satisfied=False, detail="", error="no such body"),
        Requirement(name="own", satisfied=False, detail="", counts=False),
    ],
)  # fmt: skip


def test_a_job_that_completed_tells_what_its_robot_did(service: Service) -> None:
    """`Completed` says of a job only that its run ended as it should."""
    job = created(service, {})["arn"]

    def told() -> dict[str, Any] | None:
        return call("DescribeSimulationJob", {"job": job}, service).get("verdict")

    judged = SimulationJobProgress(verdict="FAIL", verdict_reason="missed: by 2 m", judged=judged_of(RESULT))
    service.catalog.update(job, judged)
    assert told() is None, "it has not ended: a cancellation may still take the verdict away"
    for event in ("prepare", "start", "finish", "complete"):
        service.catalog.transition(job, event)
    assert told() == {
        "verdict": "FAIL", "reason": "missed: by 2 m", "requirements": {"passed": 1, "failed": 1, "errors": 1},
    }  # fmt: skip
    service.catalog.update(job, SimulationJobProgress(verdict="PASS", verdict_reason=None, judged=None))
    assert told() == {"verdict": "PASS"}, "an earlier version ran it, and kept no numbers"


def test_what_was_given_is_told(service: Service) -> None:
    assert created(service, {}, loggingConfig={"recordAllRosTopics": True})["loggingConfig"] == {
        "recordAllRosTopics": True
    }
    application = created(service, {"useDefaultTools": True})["simulationApplications"][0]
    assert application["useDefaultTools"] is True


@pytest.mark.parametrize(("given", "told"), [({}, True), ({"useDefaultUploadConfigurations": False}, False)])
def test_default_uploads_come_with_own_ones_unless_they_are_refused(
    service: Service, given: dict[str, bool], told: bool
) -> None:
    application = created(service, {"uploadConfigurations": [UPLOAD], **given}, **OUTPUT)["simulationApplications"][0]

    assert application["uploadConfigurations"] == [UPLOAD]
    assert application["useDefaultUploadConfigurations"] is told


def test_built_in_applications_are_listed_where_they_are_asked_for(service: Service) -> None:
    def listed(role: str, **members: Any) -> list[str]:
        answer = call(f"List{role}Applications", members, service)
        return [each["name"] for each in answer[f"{role[0].lower()}{role[1:]}ApplicationSummaries"]]

    def named(name: str) -> list[dict[str, Any]]:
        return [{"name": "name", "values": [name]}]

    general, uri = {"name": "General"}, {"uri": "python://rover"}
    assert listed("Robot") == listed("Simulation") == []
    call("CreateRobotApplication", {"name": "rover", "robotSoftwareSuite": general, "environment": uri}, service)
    assert listed("Robot") == listed("Robot", versionQualifier="ALL") == ["rover"]
    assert listed("Robot", filters=named("scout")) == ["scout"]
    assert listed("Simulation", filters=named("indoor-navigation")) == ["indoor-navigation"]
    assert set(listed("Robot", builtIn=True)) == {"rover", "scout", "walker"}
    assert set(listed("Simulation", builtIn=True)) == {"indoor-navigation", "recorded-run"}


@pytest.mark.parametrize(
    ("built_in", "expected"), [(False, ["rover-1", "rover-0"]), (True, ["rover-1", "rover-0", "walker", "scout"])]
)
def test_pages_of_applications_have_no_holes_where_built_in_ones_are_left_out(
    service: Service, built_in: bool, expected: list[str]
) -> None:
    for number in range(2):
        robot = {
            "name": f"rover-{number}",
            "robotSoftwareSuite": {"name": "General"},
            "environment": {"uri": "python://r"},
        }
        call("CreateRobotApplication", robot, service)
    pages: list[list[str]] = []
    token: str | None = None
    while not pages or token:
        asked = {"maxResults": 1, "builtIn": built_in, **({"nextToken": token} if token else {})}
        answer = call("ListRobotApplications", asked, service)
        pages.append([each["name"] for each in answer["robotApplicationSummaries"]])
        token = answer.get("nextToken")

    assert sorted(pages, reverse=True) == sorted(([name] for name in expected), reverse=True)
    assert call("DescribeRobotApplication", {"application": "walker"}, service)["name"] == "walker"
