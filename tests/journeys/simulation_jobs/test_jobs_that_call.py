"""Jobs that call the service without a signature: each acts for itself, whatever its code asks for."""

import json
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest
from helpers.endpoint_here import ServeHere
from helpers.paths import BUNDLES

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
DENIED, FINE = 403, 200
MAY = {"describe itself", "describe itself with others of its kind", "tag itself", "health"}


def said(service: Service, arn: str) -> dict[str, Any]:
    place = service.catalog.get(arn).document["outputs"]
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/simulation.stdout.log").decode()
    return json.loads(log)


@pytest.fixture
def nosy(service: Service, order_command: Order) -> Callable[[], dict[str, Any]]:
    """Makes the request of a job that tries all it can with another job, which waits."""

    def make() -> dict[str, Any]:
        service.store.put_bytes("applications", "nosy/nosy.py", (BUNDLES / "nosy" / "nosy.py").read_bytes())
        source = {"name": "nosy", "s3Bucket": "applications", "s3Keys": ["nosy/nosy.py"]}
        data = {"dataSources": [{**source, "destination": "/home/robomaker/nosy"}]}
        other = call("CreateSimulationJob", order_command("sleep 600", tags={"of": "another"}), service)["arn"]
        variables = {"OTHER": json.dumps(other), "ORDER": json.dumps(order_command("true"))}
        return order_command("python3 $HOME/nosy/nosy/nosy.py", variables=variables, **data)

    return make


@pytest.mark.parametrize(
    ("sandbox", "network"),
    [
        ("require", "full"),
        pytest.param("require", "local", marks=pytest.mark.deep),
        pytest.param("off", "full", marks=pytest.mark.deep),
    ],
)
@pytest.mark.parametrize("creates", ["0", "1"])
def test_a_job_acts_for_itself_only(
    service: Service,
    nosy: Callable[[], dict[str, Any]],
    serve_here: ServeHere,
    monkeypatch: pytest.MonkeyPatch,
    sandbox: str,
    network: str,
    creates: str,
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", sandbox)
    monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", network)
    request = nosy()
    with serve_here(ROBOMAKER_JOBS_CREATE_JOBS=creates) as served:
        monkeypatch.setenv("AWS_ENDPOINT_URL_ROBOMAKER", served.url)
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, service)
        for page in ("/metrics", "/console", "/health"):
            with urllib.request.urlopen(f"{served.url}{page}", timeout=60) as answer:
                assert answer.status == FINE, "others are served as ever"

    assert service.catalog.get(arn).status == "Canceled", "it cancelled itself"
    assert dict(service.catalog.get(arn).tags) == {"verdict": "good"}
    found = said(service, arn)
    assert found.pop("health says") == ["status"]
    assert found.pop("cancel and be gone") == 0
    may = MAY | ({"create with its role"} if creates == "1" else set())
    assert {name: status for name, status in found.items() if status == FINE} == dict.fromkeys(may, FINE)
    assert {status for name, status in found.items() if name not in may} == {DENIED}
    [other] = [job for job in service.catalog.list("simulation-job").resources if job.tags.get("of") == "another"]
    assert other.status == "Pending"
    assert not service.catalog.cancel_requested(other.arn)
    assert dict(other.tags) == {"of": "another"}
    assert len(service.catalog.list("simulation-job").resources) == 2 + int(creates)
