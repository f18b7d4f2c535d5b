"""Calls of either kind of application, as a client makes them."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from prefect_robomaker.schemas.wire.errors import ServiceError
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

BUCKET = "applications"
PACKAGE = {"environment": {"uri": "python://my_robot"}}


@dataclass(frozen=True)
class Applications:
    """The six operations of one kind of application."""

    role: Literal["Robot", "Simulation"]
    service: Service
    suites: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, role: Literal["Robot", "Simulation"], service: Service) -> "Applications":
        suites: dict[str, Any] = {"robotSoftwareSuite": {"name": "General"}}
        if role == "Simulation":
            suites["simulationSoftwareSuite"] = {"name": "SimulationRuntime"}
        return cls(role, service, suites)

    def create(self, name: str = "mine", **members: Any) -> dict[str, Any]:
        content = {} if {"sources", "environment"} & members.keys() else PACKAGE
        request = {"name": name, **self.suites, **content, **members}
        return call(f"Create{self.role}Application", request, self.service)

    def update(self, application: str, **members: Any) -> dict[str, Any]:
        return call(
            f"Update{self.role}Application", {"application": application, **self.suites, **members}, self.service
        )

    def version(self, application: str, **members: Any) -> dict[str, Any]:
        return call(f"Create{self.role}ApplicationVersion", {"application": application, **members}, self.service)

    def describe(self, application: str, version: str | None = None) -> dict[str, Any]:
        return call(f"Describe{self.role}Application", _selection(application, version), self.service)

    def delete(self, application: str, version: str | None = None) -> None:
        assert call(f"Delete{self.role}Application", _selection(application, version), self.service) == {}

    def page(self, **members: Any) -> tuple[list[dict[str, Any]], str | None]:
        answer = call(f"List{self.role}Applications", members, self.service)
        return answer[f"{self.role.lower()}ApplicationSummaries"], answer.get("nextToken")

    def listed(self, **members: Any) -> list[tuple[str, str]]:
        """Name and version of every entry, over all pages."""
        found, token = self.page(**members)
        while token is not None:
            more, token = self.page(**members, nextToken=token)
            found += more
        return [(entry["name"], entry["version"]) for entry in found]

    def stored(self, key: str, content: bytes = b"content") -> list[dict[str, str]]:
        """Stores an archive and returns the sources that name it."""
        self.service.store.ensure_bucket(BUCKET)
        self.service.store.put_bytes(BUCKET, key, content)
        return [{"s3Bucket": BUCKET, "s3Key": key}]


def _selection(application: str, version: str | None) -> dict[str, str]:
    return (
        {"application": application} if version is None else {"application": application, "applicationVersion": version}
    )


def at_once(calls: list[Callable[[], Any]]) -> list[Any]:
    """Makes calls at the same moment; gives each answer, or the error in its place."""
    answers: list[Any] = [None] * len(calls)
    start = threading.Barrier(len(calls))

    def run(index: int) -> None:
        start.wait()
        try:
            answers[index] = calls[index]()
        except ServiceError as error:
            answers[index] = error

    threads = [threading.Thread(target=run, args=(index,)) for index in range(len(calls))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers
