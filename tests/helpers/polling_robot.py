"""A robot as a small HTTP client: it polls, and says what a test has it say."""

import json
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from helpers.processes import wait_for
from prefect_robomaker.tasks.execution.leases.leased_runs import run_under_lease
from prefect_robomaker.tasks.fleet.deployment_runs import DeploymentRun
from prefect_robomaker.tasks.service.service import Service


@dataclass(frozen=True)
class PollingRobot:
    """A robot at a server."""

    url: str
    name: str
    token: str

    @property
    def base_url(self) -> str:
        return f"{self.url}/DEFAULT/controller/v1/{self.name}"

    def get(self, url: str, **headers: str) -> bytes:
        return self._send(urllib.request.Request(url, headers=self._headers(headers)))

    def links(self) -> dict[str, Any]:
        """What a poll shows."""
        return json.loads(self.get(self.base_url))["_links"]

    def poll_status(self) -> int:
        """The status of the answer to a poll."""
        try:
            self.links()
        except urllib.error.HTTPError as error:
            return error.code
        return 200

    def wait_for_link(self, kind: str) -> str:
        """Polls until it is asked for something of a kind; returns the address."""
        wait_for(lambda: kind in self.links(), f"{kind} for {self.name}")
        return self.links()[kind]["href"]

    def fetch_order(self) -> dict[str, Any]:
        """Polls until there is an order, and reads it."""
        return json.loads(self.get(self.wait_for_link("deploymentBase")))

    def download(self, order: dict[str, Any]) -> bytes:
        return self.get(artifact_of(order)["_links"]["download-http"]["href"])

    def say(self, url: str, execution: str, finished: str = "none", *details: str) -> int:
        """Says how an order, or its cancellation, goes; returns the status of the answer."""
        status = {"execution": execution, "result": {"finished": finished}, "details": list(details)}
        body = json.dumps({"status": status}).encode()
        headers = self._headers({"Content-Type": "application/json"})
        try:
            self._send(urllib.request.Request(f"{url}/feedback", body, headers, method="POST"))
        except urllib.error.HTTPError as error:
            return error.code
        return 200

    def say_of(self, order: dict[str, Any], execution: str, finished: str = "none", *details: str) -> int:
        """Says how an order goes."""
        return self.say(f"{self.base_url}/deploymentBase/{order['id']}", execution, finished, *details)

    def describe_itself(self, **attributes: str) -> None:
        body = json.dumps({"mode": "merge", "data": attributes}).encode()
        headers = self._headers({"Content-Type": "application/json"})
        self._send(urllib.request.Request(f"{self.base_url}/configData", body, headers, method="PUT"))

    def _headers(self, others: dict[str, str]) -> dict[str, str]:
        return {"Authorization": f"TargetToken {self.token}", **others}

    def _send(self, request: urllib.request.Request) -> bytes:
        with urllib.request.urlopen(request, timeout=200) as answer:
            return answer.read()


def artifact_of(order: dict[str, Any]) -> dict[str, Any]:
    """The file of an order."""
    ((chunk,),) = (order["deployment"]["chunks"],)
    (artifact,) = chunk["artifacts"]
    return artifact


@contextmanager
def carried_out(job: str, service: Service) -> Iterator[None]:
    """Carries a deployment job out in a thread, as job workers do; waits for its end."""
    thread = threading.Thread(target=_carry_out, args=(job, service))
    thread.start()
    try:
        yield
    except BaseException:
        service.catalog.request_cancel(job)
        thread.join(200)
        raise
    thread.join(200)
    assert not thread.is_alive(), f"{job} has not ended"


def _carry_out(job: str, service: Service) -> None:
    def run(lease: Any) -> None:
        DeploymentRun(lease, service, lambda duration_s: time.sleep(min(duration_s, 0.1))).run()

    run_under_lease(job, "deployment-job", service, run)
