"""Any sequence of calls against a catalog and against a dictionary gives the same."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from prefect_robomaker.schemas.lifecycles import SIMULATION_JOB
from prefect_robomaker.schemas.wire.errors import (
    IdempotentParameterMismatchException,
    ResourceAlreadyExistsException,
    StateConflictError,
)
from prefect_robomaker.tasks.catalog import Catalog, ClientToken, Resource

NewDatabase = Callable[[], AbstractContextManager[str]]
KIND = "simulation-job"
OWNERS = st.sampled_from(["a", "b"])


class CatalogMachine(RuleBasedStateMachine):
    """The model: resources in order of creation, who has which lease, what each token made."""

    arns = Bundle("arns")

    def __init__(self, empty_catalog: NewDatabase) -> None:
        super().__init__()
        self.empty_catalog = empty_catalog
        self.resources = ExitStack()

    @initialize()
    def open(self) -> None:
        self.now = datetime(2025, 1, 1, tzinfo=UTC)
        url = self.resources.enter_context(self.empty_catalog())
        self.catalog = Catalog.open(url, clock=lambda: self.now)
        self.resources.callback(self.catalog.close)
        self.model: dict[str, dict[str, Any]] = {}
        self.tokens: dict[str, tuple[str, str]] = {}
        self.made = 0

    @rule(
        target=arns,
        token=st.none() | st.sampled_from(["t1", "t2"]),
        request_hash=st.sampled_from(["h1", "h2"]),
        name=st.sampled_from(["x", "y"]),
        unique=st.booleans(),
    )
    def create(self, token: str | None, request_hash: str, name: str, unique: bool) -> str:
        self.made += 1
        new = Resource.new(
            arn=f"arn:aws:robomaker:us-east-1:111122223333:{KIND}/sim-{self.made}",
            kind=KIND,
            id=f"sim-{self.made}",
            name=name,
            status="Pending",
        )

        def call() -> Resource:
            client_token = None if token is None else ClientToken("CreateSimulationJob", token, request_hash)
            return self.catalog.create(new, token=client_token, unique_name=unique)

        if token in self.tokens:
            earlier_hash, arn = self.tokens[token]
            if earlier_hash == request_hash:
                assert call().arn == arn
            else:
                with pytest.raises(IdempotentParameterMismatchException):
                    call()
        elif unique and any(each["unique"] and each["name"] == name for each in self.model.values()):
            with pytest.raises(ResourceAlreadyExistsException):
                call()
        else:
            assert call().arn == new.arn
            self.model[new.arn] = {"name": name, "unique": unique, "status": "Pending", "document": {}, "lease": None}
            if token is not None:
                self.tokens[token] = (request_hash, new.arn)
        return new.arn

    @rule(arn=arns, event=st.sampled_from(sorted(SIMULATION_JOB.events)), owner=st.none() | OWNERS)
    def transition(self, arn: str, event: str, owner: str | None) -> None:
        if arn not in self.model:
            return
        entry = self.model[arn]
        after = {(begin, what): end for (begin, what), end in SIMULATION_JOB.transitions.items()}.get(
            (entry["status"], event)
        )
        holds = owner is None or (entry["lease"] is not None and entry["lease"][0] == owner)
        if after is None or not holds:
            with pytest.raises(StateConflictError):
                self.catalog.transition(arn, event, owner=owner, document_changes={"last": event})
        else:
            assert self.catalog.transition(arn, event, owner=owner, document_changes={"last": event}).status == after
            entry["status"] = after
            entry["document"] = {**entry["document"], "last": event}

    @rule(arn=arns, value=st.integers())
    def update(self, arn: str, value: int) -> None:
        if arn in self.model:
            self.catalog.update(arn, lambda document: {**document, "value": value})
            self.model[arn]["document"] = {**self.model[arn]["document"], "value": value}

    @rule(arn=arns, owner=OWNERS)
    def claim(self, arn: str, owner: str) -> None:
        if arn not in self.model:
            return
        lease = self.model[arn]["lease"]
        free = lease is None or lease[0] == owner or lease[1] <= self.now
        assert self.catalog.claim(arn, owner, 10) is free
        if free:
            self.model[arn]["lease"] = (owner, self.now + timedelta(seconds=10))

    @rule(arn=arns, owner=OWNERS)
    def release(self, arn: str, owner: str) -> None:
        if arn in self.model:
            held = self.model[arn]["lease"] is not None and self.model[arn]["lease"][0] == owner
            assert self.catalog.release(arn, owner) is held
            if held:
                self.model[arn]["lease"] = None

    @rule(arn=arns)
    def delete(self, arn: str) -> None:
        if arn in self.model:
            self.catalog.delete(arn)
            del self.model[arn]
            self.tokens = {token: made for token, made in self.tokens.items() if made[1] != arn}

    @rule(seconds=st.integers(1, 11))
    def wait(self, seconds: int) -> None:
        self.now += timedelta(seconds=seconds)

    @rule(limit=st.integers(1, 3), status=st.none() | st.sampled_from(["Pending", "Running"]))
    def list_pages(self, limit: int, status: str | None) -> None:
        filters = {} if status is None else {"status": [status]}
        listed, after = [], None
        while True:
            page = self.catalog.list(KIND, filters=filters, limit=limit, after=after)
            listed += [resource.arn for resource in page.resources]
            if (after := page.next_token) is None:
                break
        expected = [arn for arn, entry in self.model.items() if status in (None, entry["status"])]
        assert listed == expected[::-1]

    @invariant()
    def everything_is_as_in_the_model(self) -> None:
        found = self.catalog.list(KIND, limit=1000).resources
        assert {each.arn: (each.name, each.status, each.document) for each in found} == {
            arn: (entry["name"], entry["status"], entry["document"]) for arn, entry in self.model.items()
        }

    def teardown(self) -> None:
        self.resources.close()


def test_a_catalog_is_like_a_dictionary(database: str, empty_catalog: NewDatabase) -> None:
    class Machine(CatalogMachine):
        def __init__(self) -> None:
            super().__init__(empty_catalog)

    number = 40 if database == "sqlite" else 25  # the same code but for the driver
    run_state_machine_as_test(Machine, settings=examples(number, stateful_step_count=30))
