"""Visitors who order runs, of which no process is begun, and specifications to order."""

import html
import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.spec_runs.spec_runs import SpecRuns, Standing, write_standing
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.tasks.service.service import Service

ADMIN = AccessKey("ADMIN", "word", "admin")
SUBMIT = AccessKey("SUBMIT", "word", "submitter", "submit")
READER = AccessKey("READ", "word", "reader", "read")
RED = AccessKey("RED", "word", "red", "submit", (), ("team=red",))
KEYS = (ADMIN, SUBMIT, READER, RED)


class KeptRuns(SpecRuns):
    """Keeps orders; each counts as going until it is ended by hand."""

    def __init__(self, service: Service) -> None:
        super().__init__(service.settings.home, {})
        self.home = service.settings.home
        self.orders: list[Order] = []
        self.ended: set[str] = set()
        self.cancelled: list[str] = []
        self.killed: set[str] = set()

    def begin(self, order: Order, standing: Standing) -> None:
        (self.home / "runs" / order.run_id).mkdir(parents=True)
        write_standing(self.home / "runs" / order.run_id, standing)
        self.orders.append(order)

    def going(self) -> list[str]:
        return [order.run_id for order in self.orders if order.run_id not in self.ended]

    def is_going(self, run_id: str) -> bool:
        return run_id in self.going()

    def has_broken_off(self, run_id: str) -> bool:
        return run_id in self.killed & self.ended

    def take_up(self, run_id: str) -> bool:
        if not self.has_broken_off(run_id):
            return False
        self.ended.remove(run_id)
        return True

    def cancel(self, run_id: str) -> None:
        self.cancelled.append(run_id)


class Visitor:
    """A browser that may have logged in, and sends forms as its pages have them."""

    def __init__(self, browser: Any, key: AccessKey | None) -> None:
        self.browser = browser
        if key is not None:
            browser.post("/console/login", data={"key": key.id, "secret": key.secret})
        page = browser.get("/console/jobs" if key else "/console/runs/new").text
        found = re.search(r'name="form_token" value="([^"]+)"', page)
        self.token = html.unescape(found[1]) if found else ""

    def get(self, path: str) -> httpx.Response:
        """Reads a page."""
        return self.browser.get(f"/console{path}")

    def send(self, path: str, headers: dict[str, str] | None = None, **fields: str) -> httpx.Response:
        """Sends a form."""
        return self.browser.post(
            f"/console{path}", data={"form_token": self.token, **fields}, headers=headers, follow_redirects=False
        )


@pytest.fixture
def runs(service: Service) -> KeptRuns:
    return KeptRuns(service)


@pytest.fixture
def enter(visitor: Callable[..., Any], runs: KeptRuns) -> Callable[..., Visitor]:
    """Enters the console, with an access key or where none is asked for."""
    return lambda key=None, **members: Visitor(visitor(*(KEYS if key else ()), spec_runs=runs, **members), key)
