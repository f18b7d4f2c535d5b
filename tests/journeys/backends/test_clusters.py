"""Batches whose jobs run on Dask and Ray clusters of real processes."""

import re
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.clusters import Cluster, of_home
from helpers.processes import started, wait_for

from prefect_robomaker.tasks.backends.backend import BackendError, JobWorkers, open_backend
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

from .conftest import ONE_OF_THEM, BatchOnCluster

Order = Callable[..., dict[str, Any]]
Begin = Callable[..., BatchOnCluster]
LONG = {"DURATION_S": "200"}
pytestmark = pytest.mark.timeout(900)


@pytest.mark.parametrize("cluster", ["ray"], indirect=True)
@pytest.mark.deep
def test_jobs_run_on_all_machines_and_a_cancelled_batch_leaves_nothing_there(
    order: Order, cluster: Cluster, begin: Begin
) -> None:
    """The batch of the next test is cancelled on Dask."""
    cluster.add("first")
    cluster.add("second")
    batch = begin([order(LONG) for _ in range(3)], maxConcurrency=3)

    cluster.await_job_on("first")
    cluster.await_job_on("second")
    call("CancelSimulationJobBatch", {"batch": batch.arn}, batch.service)

    assert batch.ending.result(180)["status"] == "Canceled"
    assert set(batch.statuses()) == {"Canceled"}
    assert not of_home(cluster.home("first")) | of_home(cluster.home("second"))
    assert cluster.remains() == []


@pytest.mark.parametrize("cluster", ONE_OF_THEM, indirect=True)
def test_machines_come_and_die_while_a_batch_runs_and_a_cancelled_one_leaves_nothing_there(
    order: Order, cluster: Cluster, begin: Begin
) -> None:
    batch = begin([order(LONG, maxJobDurationInSeconds=600) for _ in range(2)], maxConcurrency=2)
    cluster.add("first")
    cluster.await_job_on("first")
    cluster.add("second")
    cluster.await_job_on("second")

    cluster.kill("first")
    wait_for(lambda: not of_home(cluster.home("first")), "the job worker to end with its machine")
    cluster.add("third")

    cluster.await_job_on("third")
    assert of_home(cluster.home("second"))
    assert batch.statuses() == ["Running", "Running"]

    cluster.kill_all_of("second")  # its power fails, so that leases have to run out
    cluster.add("fourth")

    cluster.await_job_on("fourth")
    assert batch.statuses() == ["Running", "Running"]

    call("CancelSimulationJobBatch", {"batch": batch.arn}, batch.service)
    assert batch.ending.result(180)["status"] == "Canceled"
    assert set(batch.statuses()) == {"Canceled"}
    assert not of_home(cluster.home("third")) | of_home(cluster.home("fourth"))
    assert cluster.remains() == []


@pytest.mark.parametrize("cluster", ONE_OF_THEM, indirect=True)
def test_a_machine_with_another_catalog_says_so_and_the_others_go_on(
    order: Order, cluster: Cluster, begin: Begin, service: Service, tmp_path: Path
) -> None:
    cluster.add("astray", ROBOMAKER_CATALOG_URL=f"sqlite:///{tmp_path}/other.db")
    batch = begin([order(LONG)], maxConcurrency=2)
    ended = batch.ending.result(240)
    assert ended["status"] == "Failed"
    assert re.search(r"the catalog of this machine, sqlite:.*other\.db, does not have", ended["failureReason"])
    assert "set ROBOMAKER_CATALOG_URL" in ended["failureReason"]

    cluster.add("right")
    arn = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order(LONG)]}, service)["arn"]
    backend = open_backend(cluster.backend)
    assert backend is not None
    with backend.job_workers(arn, 2) as workers:
        said = re.compile(r"1 job worker on the (Dask|Ray) cluster .*; .*other\.db, does not have")
        wait_for(lambda: said.match(workers.look()), "what is said of the first machine")
        assert of_home(cluster.home("right"))
    assert not of_home(cluster.home("right"))


@pytest.mark.parametrize("cluster", ONE_OF_THEM, indirect=True)
def test_a_cluster_that_goes_away_is_waited_for(order: Order, cluster: Cluster, begin: Begin) -> None:
    cluster.add("first")
    batch = begin([order({"DURATION_S": "10"}) for _ in range(2)], maxConcurrency=1)
    cluster.await_job_on("first")

    cluster.kill("first")
    cluster.restart_head()
    cluster.add("second")

    assert batch.ending.result(180)["status"] == "Completed"
    assert "second" in batch.machines()


@pytest.mark.parametrize("kind", ["dask", "ray"])
def test_a_cluster_that_does_not_answer_is_an_error_that_says_what_to_check(kind: str) -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        backend = open_backend(f"{kind}:127.0.0.1:{silent.getsockname()[1]}")
        assert backend is not None
        with (
            pytest.raises(
                BackendError, match=r"127\.0\.0\.1.* does not answer .*check the address in ROBOMAKER_BACKEND"
            ),
            backend.job_workers("arn", 1),
        ):
            pytest.fail("no cluster is there")


@pytest.mark.parametrize("cluster", ONE_OF_THEM, indirect=True)
def test_job_workers_end_with_the_process_that_runs_the_batch(
    order: Order, cluster: Cluster, service: Service, prefect_server: str, tmp_path: Path
) -> None:
    """However it ends."""
    cluster.add("first")
    request = {"createSimulationJobRequests": [order(LONG, maxJobDurationInSeconds=600)]}
    arn = call("StartSimulationJobBatch", request, service)["arn"]
    command = [sys.executable, "-m", "prefect_robomaker", "perform", arn]
    environ = {
        "ROBOMAKER_HOME": str(service.settings.home),
        "ROBOMAKER_BACKEND": cluster.backend,
        "PREFECT_API_URL": prefect_server,
    }
    with started(command, environ, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as coordinator:
        cluster.await_job_on("first")
        coordinator.kill()

    wait_for(lambda: not of_home(cluster.home("first")), "the job worker to end")
    wait_for(lambda: cluster.remains() == [], "the cluster to forget its task")
    assert call("DescribeSimulationJobBatch", {"batch": arn}, service)["status"] in ("InProgress", "Completing")


@pytest.mark.parametrize("cluster", ONE_OF_THEM, indirect=True)
def test_a_machine_without_the_package_says_so(cluster: Cluster) -> None:
    cluster.add("bare", **cluster.without_package())
    backend = open_backend(cluster.backend)
    assert backend is not None

    def refused(workers: JobWorkers) -> str:
        try:
            workers.look()
        except BackendError as error:
            return str(error)
        return ""

    with backend.job_workers("arn", 1) as workers:
        said = wait_for(lambda: refused(workers), "the refusal")
    assert re.match(
        r"no machine of the (Dask|Ray) cluster .* can run jobs: .*No module named 'prefect_robomaker'", said
    )
