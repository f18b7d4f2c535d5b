"""Jobs that call the service without a signature: each acts for itself, whatever its code asks for."""

import json
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest
from helpers.endpoint_here import ServeHere
from helpers.paths import BUNDLES

from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
DENIED, FINE = 403, 200
MAY = {"describe itself", "describe itself with others of its kind", "tag itself", "health"}


def said(service: Service, arn: str) -> Any:
    place = service.catalog.get(arn).document["outputs"]
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/simulation.stdout.log").decode()
    return json.loads(log)


@pytest.fixture
def nosy(service: Service, order_command: Order) -> Callable[[str], dict[str, Any]]:
    """Makes the request of a job that tries all it can with another job, which waits."""

    def make(by: str) -> dict[str, Any]:
        service.store.put_bytes("applications", "nosy/nosy.py", (BUNDLES / "nosy" / "nosy.py").read_bytes())
        source = {"name": "nosy", "s3Bucket": "applications", "s3Keys": ["nosy/nosy.py"]}
        data = {"dataSources": [{**source, "destination": "/home/robomaker/nosy"}]}
        other = call("CreateSimulationJob", order_command("sleep 600", tags={"of": "another"}), service)["arn"]
        variables = {"BY": by, "OTHER": json.dumps(other), "ORDER": json.dumps(order_command("true"))}
        return order_command("python3 $HOME/nosy/nosy/nosy.py", variables=variables, **data)

    return make


@pytest.mark.parametrize(
    ("sandbox", "network", "creates", "by"),
    [
        ("require", "full", "0", "process"),
        ("require", "full", "1", "process"),
        pytest.param("require", "local", "1", "key", marks=pytest.mark.deep),
        pytest.param("off", "full", "0", "process", marks=pytest.mark.deep),
        # Other pairs of these.
        pytest.param("require", "full", "1", "key", marks=pytest.mark.endurance),
        pytest.param("require", "local", "0", "process", marks=pytest.mark.endurance),
        pytest.param("require", "local", "1", "process", marks=pytest.mark.endurance),
        pytest.param("off", "full", "1", "process", marks=pytest.mark.endurance),
        pytest.param("off", "full", "1", "key", marks=pytest.mark.endurance),
    ],
)
def test_a_job_acts_for_itself_only(
    service: Service,
    nosy: Callable[[str], dict[str, Any]],
    serve_here: ServeHere,
    monkeypatch: pytest.MonkeyPatch,
    sandbox: str,
    network: str,
    creates: str,
    by: str,
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", sandbox)
    monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", network)
    # One of this test's own: that of the process has the confinement with which an earlier test has started it.
    own = Launcher()
    monkeypatch.setattr(job_runs, "launcher", lambda: own)
    request = nosy(by)
    with own, serve_here(ROBOMAKER_JOBS_CREATE_JOBS=creates, ROBOMAKER_TRUSTED_PROXIES="127.0.0.1") as served:
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
    others = {name: status for name, status in found.items() if name not in may}
    if by == "key":  # there is no console among a job's own paths
        assert {others.pop(name) for name in ("console", "console of the other")} == {404}
    assert set(others.values()) == {DENIED}
    [other] = [job for job in service.catalog.list("simulation-job").resources if job.tags.get("of") == "another"]
    assert other.status == "Pending"
    assert not service.catalog.cancel_requested(other.arn)
    assert dict(other.tags) == {"of": "another"}
    assert len(service.catalog.list("simulation-job").resources) == 2 + int(creates)


def test_a_key_of_a_job_is_gone_with_its_run(
    service: Service, order_command: Order, serve_here: ServeHere, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = "echo '\"'$AWS_ENDPOINT_URL_ROBOMAKER'\"'"
    with serve_here() as served:
        monkeypatch.setenv("AWS_ENDPOINT_URL_ROBOMAKER", served.url)
        arn = call("CreateSimulationJob", order_command(script), service)["arn"]
        perform_job(arn, service)
        own_url = said(service, arn)
        assert own_url.startswith(f"{served.url}/of-job/")
        for url in (own_url, own_url[:-1], f"{served.url}/of-job/none/none", f"{served.url}/of-job//"):
            request = urllib.request.Request(f"{url}/describeSimulationJob", json.dumps({"job": arn}).encode())
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(request, timeout=60)
