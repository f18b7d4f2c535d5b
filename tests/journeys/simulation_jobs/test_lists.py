"""Lists of simulation jobs, what their descriptions hold, and requests as clients of all years sent them."""

from collections.abc import Callable
from typing import Any

import pytest
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]


def create(service: Service, **members: Any) -> str:
    """Stores a job of applications that are always there; returns its ARN."""
    config = {"application": "indoor-navigation", "launchConfig": {}}
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "simulationApplications": [config], **members}
    return call("CreateSimulationJob", request, service)["arn"]


def listed(service: Service, **members: Any) -> list[str]:
    return [job["arn"] for job in call("ListSimulationJobs", members, service)["simulationJobSummaries"]]


def only(name: str, value: str) -> list[dict[str, Any]]:
    return [{"name": name, "values": [value]}]


def test_a_list_names_jobs_with_their_applications_and_data(service: Service, order: Order) -> None:
    service.store.put_bytes("applications", "map.txt", b"map")
    data = [{"name": "maps", "s3Bucket": "applications", "s3Keys": ["map.txt"]}]
    job = call("CreateSimulationJob", order(dataSources=data, compute={"computeType": "CPU"}), service)

    answer = call("ListSimulationJobs", {}, service)

    assert answer == {
        "simulationJobSummaries": [
            {
                "arn": job["arn"],
                "lastUpdatedAt": job["lastUpdatedAt"],
                "name": job["arn"].rsplit("/", 1)[1],
                "status": "Pending",
                "simulationApplicationNames": ["sleeper"],
                "robotApplicationNames": ["watcher"],
                "dataSourceNames": ["maps"],
                "computeType": "CPU",
            }
        ]
    }


def test_filters_compare_the_status_and_the_names_of_the_applications(service: Service, order: Order) -> None:
    sleeping = call("CreateSimulationJob", order(), service)["arn"]
    plain = create(service)
    call("CancelSimulationJob", {"job": plain}, service)

    assert listed(service, filters=only("simulationApplicationName", "sleeper")) == [sleeping]
    assert listed(service, filters=only("robotApplicationName", "watcher")) == [sleeping]
    assert listed(service, filters=only("robotApplicationName", "scout")) == []
    assert listed(service, filters=only("simulationApplicationName", "indoor-navigation")) == [plain]
    assert listed(service, filters=only("status", "Canceled")) == [plain]
    assert listed(service, filters=only("status", "Pending")) == [sleeping]
    with pytest.raises(InvalidParameterException, match="robotApplicationName, simulationApplicationName, status"):
        listed(service, filters=only("robotName", "watcher"))


def test_a_page_never_has_more_than_100_jobs_whatever_is_asked(service: Service) -> None:
    arns = [create(service) for _ in range(102)]

    page = call("ListSimulationJobs", {"maxResults": 1000}, service)
    rest = call("ListSimulationJobs", {"maxResults": 1000, "nextToken": page["nextToken"]}, service)

    assert len(page["simulationJobSummaries"]) == 100
    assert "nextToken" not in rest
    both = page["simulationJobSummaries"] + rest["simulationJobSummaries"]
    assert [job["arn"] for job in both] == arns[::-1]
    with pytest.raises(InvalidParameterException, match="maxResults"):
        listed(service, maxResults=1001)


@pytest.mark.deep
def test_a_job_on_its_way_to_failed_says_why_while_its_outputs_are_stored(
    service: Service, order: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = call("CreateSimulationJob", order({"FAIL_AT_STEP": "2"}), service)["arn"]
    seen: list[dict[str, Any]] = []
    put_files = service.store.put_files

    def look(*arguments: Any, **options: Any) -> Any:
        seen.append(call("DescribeSimulationJob", {"job": arn}, service))
        return put_files(*arguments, **options)

    monkeypatch.setattr(service.store, "put_files", look)
    job_runs.perform_job(arn, service)

    assert (seen[0]["status"], seen[0]["failureCode"]) == ("Terminating", "SimulationApplicationCrash")
    assert "the simulated floor gave way" in seen[0]["failureReason"]


def test_a_description_has_what_clients_count_on_and_nothing_that_is_not_so(service: Service) -> None:
    arn = create(service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    [same] = call("BatchDescribeSimulationJob", {"jobs": [arn]}, service)["jobs"]

    assert same == job
    assert job["tags"] == {}
    assert job["failureBehavior"] == "Fail"
    assert not {"failureCode", "failureReason", "outputLocation", "networkInterface", "dataSources"} & set(job)
    assert not [member for member, value in job.items() if value is None]


APPLICATION = {"application": "indoor-navigation", "launchConfig": {}}
UNSAID = {
    "applicationVersion": "$LATEST",
    "uploadConfigurations": [],
    "useDefaultUploadConfigurations": False,
    "useDefaultTools": False,
}


@pytest.mark.parametrize(
    ("members", "echoed"),
    [
        ({"outputLocation": {}}, {"outputLocation": None}),
        (
            {"simulationApplications": [{**APPLICATION, "worldConfigs": [], "tools": [], "uploadConfigurations": []}]},
            {},
        ),
        (
            {
                "simulationApplications": [
                    {
                        "application": "indoor-navigation",
                        "launchConfig": {
                            "streamUI": True,
                            "portForwardingConfig": {"portMappings": []},
                            "environmentVariables": {},
                        },
                    }
                ]
            },
            {},
        ),
        (
            {
                "outputLocation": {"s3Bucket": "results", "s3Prefix": "logs"},
                "loggingConfig": {"recordAllRosTopics": True},
                "simulationApplications": [
                    {**APPLICATION, "useDefaultTools": True, "useDefaultUploadConfigurations": True}
                ],
            },
            {"outputLocation": {"s3Bucket": "results", "s3Prefix": "logs"}},
        ),
        (
            {
                "vpcConfig": {
                    "subnets": ["subnet-1", "subnet-1"],
                    "securityGroups": ["sg-1"],
                    "assignPublicIp": True,
                },
                "simulationApplications": [
                    {
                        "application": "indoor-navigation",
                        "launchConfig": {
                            "portForwardingConfig": {
                                "portMappings": [{"jobPort": 80, "applicationPort": 9090, "enableOnPublicIp": True}]
                            }
                        },
                    }
                ],
            },
            {"vpcConfig": {"subnets": ["subnet-1", "subnet-1"], "securityGroups": ["sg-1"], "assignPublicIp": True}},
        ),
        (
            {"compute": {"simulationUnitLimit": 4, "computeType": "GPU_AND_CPU", "gpuUnitLimit": 1}},
            {"compute": {"simulationUnitLimit": 4, "computeType": "GPU_AND_CPU", "gpuUnitLimit": 1}},
        ),
        ({"compute": {"simulationUnitLimit": 2}}, {"compute": {"simulationUnitLimit": 2, "computeType": "CPU"}}),
        ({"simulationApplications": None, "robotApplications": [{"application": "scout", "launchConfig": {}}]}, {}),
    ],
    ids=["no place", "empty lists", "no ports", "defaults", "network", "processors", "few processors", "robot only"],
)
def test_requests_of_all_years_are_accepted_and_echoed(
    service: Service, members: dict[str, Any], echoed: dict[str, Any]
) -> None:
    arn = create(service, **members)

    job = call("DescribeSimulationJob", {"job": arn}, service)

    assert job["loggingConfig"] == {"recordAllRosTopics": False, **members.get("loggingConfig", {})}
    for member in ("simulationApplications", "robotApplications"):
        sent = members.get(member, job.get(member))
        found = job.get(member)
        if sent is not members.get(member) or not sent:
            assert found == (sent and [{**UNSAID, **each} for each in sent])
            continue
        assert [each.pop("application").split("/")[-2] for each in found] == [each["application"] for each in sent]
        named = [{name: value for name, value in each.items() if name != "application"} for each in sent]
        assert found == [{**UNSAID, **each} for each in named], "as they were sent, with ARNs and defaults"
    for member, value in echoed.items():
        found: Any = job.get(member)
        assert (found if not isinstance(value, dict) else {key: found[key] for key in value}) == value
