"""`robomaker serve`: jobs that clients order are carried out, and nothing is left behind or done twice."""

import contextlib
import http.client
import os
import signal
import socket
import threading
import urllib.error
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from helpers.endpoint_here import ServeHere
from helpers.endpoint_process import Serve, Served
from helpers.processes import alive, descendants, wait_for, working_below

from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
LONG = {"DURATION_S": "200"}
BATCH = "simulation-job-batch"


@pytest.mark.deep
def test_interrupted_jobs_are_gone_on_with_by_the_next_one(
    serve: Serve, service: Service, order: Order, prefect_server: str
) -> None:
    with serve("--max-jobs", "2", PREFECT_API_URL=prefect_server) as served:
        served.wait_until_ready()
        short = served.call("CreateSimulationJob", order())["arn"]
        wait_for(lambda: status(service, short) == "Completed", "the short job")
        long = served.call("CreateSimulationJob", order(LONG))["arn"]
        wait_for(lambda: status(service, long) == "Running", "the long job")
        batch = served.call("StartSimulationJobBatch", {"createSimulationJobRequests": [order(LONG)]})["arn"]
        wait_for(lambda: children(service, batch) == ["Running"], "the batch's job")
        waiting = served.call("CreateSimulationJob", order())["arn"]  # two jobs run on the machine already
        told = "1 of at most 2 running, 1 waiting"
        wait_for(lambda: served.worker()["simulation-job"] == told, "the health page")
        [why] = served.worker()["waiting"]
        assert why.startswith(f"{waiting.rpartition('/')[2]}: 2 jobs run on this machine")
        wait_for(lambda: status(service, batch) == "Completing", "the batch's last request")
        # The job worker, its warm parent of simulations, two supervisors and simulations.
        wait_for(lambda: len(descendants(served.process.pid)) >= 6, "the processes of both jobs")
        processes = descendants(served.process.pid)
        served.process.send_signal(signal.SIGINT)
        assert served.process.wait(200) == 0, served.log.read_text()

    assert status(service, waiting) == "Pending"
    assert "Interrupted: 3 simulation jobs, 1 simulation job batch; the next" in served.log.read_text()
    assert "Traceback" not in served.log.read_text()
    wait_for(lambda: not alive(processes), "the end of every process")
    assert [status(service, arn) for arn in (long, batch)] == ["Running", "Completing"]
    assert children(service, batch) == ["Running"]
    # On a busy machine Prefect may hear of it from others than the job worker, which has no time to say it twice.
    ends = lambda: {state for arn in (long, batch) for state in flow_run_states(arn)}  # noqa: E731
    wait_for(lambda: ends() == {"CRASHED"}, "the ends of the flow runs")
    first_run = service.catalog.get(long).document["runId"]

    with serve("--max-jobs", "3", PREFECT_API_URL=prefect_server) as served:
        served.wait_until_ready()
        wait_for(lambda: status(service, waiting) == "Completed", "the job that waited")
        wait_for(lambda: service.catalog.get(long).document["runId"] != first_run, "another run of the long job")
        service.catalog.request_cancel(long)
        wait_for(lambda: status(service, long) == "Canceled", "the end of the long job")
        wait_for(lambda: working_below(service.settings.home / "jobs"), "the batch's job")
        wait_for(lambda: len(descendants(served.process.pid)) >= 4, "the processes of the batch's job")
        processes = descendants(served.process.pid)
        served.process.kill()
        served.process.wait(200)
        wait_for(lambda: not alive(processes), "the end of every process")

    assert status(service, batch) == "Completing"
    assert len(service.catalog.children(batch, kind="simulation-job")) == 1


@pytest.mark.deep
def test_a_job_that_takes_worker_along_is_given_up_and_the_others_go_on_and_wait_while_prefect_is_away(
    serve: Serve, service: Service, order: Order, prefect_server: str
) -> None:
    deadly = call("CreateSimulationJob", order(LONG), service)["arn"]
    for number in range(2):  # two job workers have begun it before, and are dead
        assert service.catalog.claim(deadly, str(number), -1)

    with Forwarder(prefect_server) as forwarder, serve(PREFECT_API_URL=forwarder.url) as served:
        wait_for(lambda: status(service, deadly) == "Running", "the job")
        other = served.call("CreateSimulationJob", order({"DURATION_S": "1"}))["arn"]
        wait_for(lambda: status(service, other) == "Running", "the other job")
        os.kill(served.worker()["pid"], signal.SIGKILL)
        wait_for(lambda: status(service, deadly) == "Failed", "the end of the job")
        wait_for(lambda: status(service, other) == "Completed", "the end of the other job")

        assert served.worker()["restarts"] == 1
        assert "the job worker was killed by signal 9; it is started again in 0.5 s" in served.log.read_text()
        described = served.call("DescribeSimulationJob", {"job": deadly})

        jobs_wait_without_prefect(served, forwarder, service, order)
        a_second_ctrl_c_does_not_wait(served)
    assert described["failureCode"] == "InternalServiceError"
    assert "3 job workers died" in described["failureReason"]
    assert service.catalog.lost_workers(other) == 1


def jobs_wait_without_prefect(served: Served, forwarder: "Forwarder", service: Service, order: Order) -> None:
    """Takes the Prefect server away for a while; the endpoint answers meanwhile."""
    served.wait_until_ready()
    forwarder.stop()
    wait_for(lambda: served.worker()["state"] == "waiting for Prefect", "the news that Prefect is gone")
    arn = served.call("CreateSimulationJob", order())["arn"]
    assert served.call("DescribeSimulationJob", {"job": arn})["status"] == "Pending"
    assert "Prefect does not answer" in served.log.read_text()
    forwarder.start()
    wait_for(lambda: status(service, arn) == "Completed", "the end of the job")
    assert "Prefect answers again" in served.log.read_text()


@pytest.mark.deep
def test_the_endpoint_alone_stores_jobs_for_others(serve: Serve, service: Service, order: Order) -> None:
    with serve("--execute", "none", "--log-requests") as served:
        arn = served.call("CreateSimulationJob", order())["arn"]
        assert served.worker() == {"state": "elsewhere"}
        assert served.facts["environment"]["AWS_ENDPOINT_URL_ROBOMAKER"] == served.url
        served.process.send_signal(signal.SIGHUP)
        assert served.process.wait(200) == 0

    assert status(service, arn) == "Pending"
    assert "POST /createSimulationJob 200" in served.log.read_text()


def test_clients_have_to_sign_when_there_are_access_keys(serve_here: ServeHere, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    keys.write_text("[default]\naws_access_key_id = AKID\naws_secret_access_key = secret\n")
    keys.chmod(0o644)
    with serve_here(ROBOMAKER_ACCESS_KEYS_FILE=str(keys)) as served:
        with pytest.raises(urllib.error.HTTPError, match="403"):
            served.call("ListWorlds", {})
        assert "AWS_ACCESS_KEY_ID" not in served.facts["environment"]
        assert "others can read the access keys" in served.log.read_text()


def test_a_trusted_proxy_says_that_visitors_come_by_https(serve_here: ServeHere, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    keys.write_text("[default]\naws_access_key_id = AKID\naws_secret_access_key = word\n")
    proxied = {"ROBOMAKER_ACCESS_KEYS_FILE": str(keys), "ROBOMAKER_TRUSTED_PROXIES": "127.0.0.1"}
    with serve_here(**proxied) as served:
        cookies = []
        for headers in ({}, {"X-Forwarded-Proto": "https"}):
            connection = http.client.HTTPConnection(urlsplit(served.url).netloc, timeout=200)
            connection.request("POST", "/console/login", "key=AKID&secret=word", headers)
            cookies.append(connection.getresponse().headers["set-cookie"])
            connection.close()

    assert ["; secure" in cookie.lower() for cookie in cookies] == [False, True]


def test_what_cannot_be_served_is_told_in_one_line(robomaker: Any, monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for words, message in [
            (("--port", port), f"cannot listen at 127.0.0.1 port {port}: Address already in use; choose another"),
            (("--port", 70000), "--port is 70000; it has to be a number from 1 to 65535"),
            (("--host", "0.0.0.0"), "set ROBOMAKER_ACCESS_KEYS_FILE to a file of access keys first"),
            (("--host", "192.0.2.1"), "--host is '192.0.2.1', which others can reach"),
            (("--max-jobs", 0), "--max-jobs is 0; it has to be a number from 1 to 9999"),
        ]:
            ended = robomaker("serve", *words)
            assert (ended.code, ended.out) == (2, "")
            assert message in ended.err
            assert len(ended.err.splitlines()) == 1
    monkeypatch.setenv("ROBOMAKER_ACCESS_KEYS_FILE", str(home / "nowhere"))
    assert "No such file" in robomaker("serve").err
    assert not home.exists()


def a_second_ctrl_c_does_not_wait(served: Served) -> None:
    """Stops `serve` although its job worker does not react."""
    processes = descendants(served.process.pid)
    os.kill(served.worker()["pid"], signal.SIGSTOP)
    served.process.send_signal(signal.SIGINT)
    wait_for(lambda: not answers(served), "the end of the endpoint")
    served.process.send_signal(signal.SIGINT)
    assert served.process.wait(200) == 130
    wait_for(lambda: not alive(processes), "the end of every process")


def answers(served: Served) -> bool:
    try:
        served.worker()
    except OSError:
        return False
    return True


def status(service: Service, arn: str) -> str:
    return service.catalog.get(arn).status


def children(service: Service, batch: str) -> list[str]:
    return [job.status for job in service.catalog.children(batch, kind="simulation-job")]


def flow_run_states(arn: str) -> list[str]:
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName

    with get_client(sync_client=True) as client:
        wanted = FlowRunFilter(name=FlowRunFilterName(any_=[arn.rsplit("/", 1)[-1]]))
        return [run.state.type.value for run in client.read_flow_runs(flow_run_filter=wanted) if run.state]


class Forwarder:
    """A port that leads to a Prefect server, and can be closed."""

    def __init__(self, api_url: str) -> None:
        self._target = (urlsplit(api_url).hostname, urlsplit(api_url).port)
        self._port = 0
        self._open: set[socket.socket] = set()

    def __enter__(self) -> "Forwarder":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._port}/api"

    def start(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def stop(self) -> None:
        for each in (self._listener, *self._open):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        self._open.clear()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = listener.accept()
                far = socket.create_connection(self._target)
                self._open |= {near, far}
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._copy, args=(source, sink), daemon=True).start()

    @staticmethod
    def _copy(source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
        for each in (source, sink):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
