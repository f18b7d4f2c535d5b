"""What the catalog does for one caller."""

import dataclasses
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from helpers.postgres_server import NEEDS_POSTGRESQL
from sqlalchemy import create_engine, text

from prefect_robomaker.schemas.operations.world_templates import CreateWorldTemplateRequest
from prefect_robomaker.schemas.wire.errors import (
    ConfigurationError,
    IdempotentParameterMismatchException,
    InvalidParameterException,
    ResourceAlreadyExistsException,
    ResourceNotFoundException,
    ServiceUnavailableException,
    StateConflictError,
)
from prefect_robomaker.tasks.catalog import Catalog, ClientToken, NewResource, database
from prefect_robomaker.tasks.catalog.database import FIRST_VERSION

MakeResource = Callable[..., NewResource]
# SQLite lets no other connection write in between.
ON_POSTGRESQL_ONLY = pytest.mark.parametrize(
    "database", [pytest.param("postgresql", marks=NEEDS_POSTGRESQL)], indirect=True
)


def token(value: str = "t-1", request_hash: str = "h-1", operation: str = "CreateSimulationJob") -> ClientToken:
    return ClientToken(operation, value, request_hash)


# Creating and reading


def test_a_resource_is_read_as_it_was_created(catalog: Catalog, make_resource: MakeResource) -> None:
    new = make_resource(
        1,
        name="first",
        parent="arn:x",
        tags={"team": "näv"},
        labels={"robot": ["a", "b"]},
        document={"request": {"a": [1, 2.5, None]}, "ü": "…"},
    )

    created = catalog.create(new, token=None)

    assert catalog.get(new.arn) == created
    assert {name: value for name, value in dataclasses.asdict(created).items() if name in dataclasses.asdict(new)} == (
        dataclasses.asdict(new)
    )
    assert (created.created_at, created.revision) == (datetime(2025, 1, 2, 3, 4, 5, 678901, tzinfo=UTC), 1)


def test_times_are_utc_whatever_zone_the_clock_has(catalog: Catalog, clock: Any, make_resource: MakeResource) -> None:
    there = clock.now = datetime(2025, 1, 2, 12, 0, tzinfo=timezone(timedelta(hours=9)))

    catalog.create(make_resource(1), token=None)

    read = catalog.get(make_resource(1).arn).created_at
    assert (read, read.utcoffset()) == (there, timedelta(0))


def test_what_does_not_exist_is_named(catalog: Catalog, make_resource: MakeResource) -> None:
    missing = make_resource(1).arn
    calls: list[Callable[[], object]] = [
        lambda: catalog.get(missing),
        lambda: catalog.delete(missing),
        lambda: catalog.update(missing, lambda document: document),
        lambda: catalog.transition(missing, "prepare"),
        lambda: catalog.request_cancel(missing),
        lambda: catalog.cancel_requested(missing),
        lambda: catalog.claim(missing, "me", 1),
        lambda: catalog.renew(missing, "me", 1),
        lambda: catalog.release(missing, "me"),
    ]

    for call in calls:
        with pytest.raises(ResourceNotFoundException, match=missing):
            call()


def test_a_resource_of_another_kind_is_not_found(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1), token=None).arn

    assert catalog.get(arn, kind="simulation-job").arn == arn
    with pytest.raises(ResourceNotFoundException, match="is a simulation-job; give the ARN of a world"):
        catalog.get(arn, kind="world")


def test_several_are_read_at_once(catalog: Catalog, make_resource: MakeResource) -> None:
    arns = [catalog.create(make_resource(number), token=None).arn for number in range(3)]

    found = catalog.get_many([*arns, "arn:missing", *(f"arn:none/{number}" for number in range(1000))])

    assert sorted(found) == arns
    assert found[arns[1]] == catalog.get(arns[1])


def test_the_newest_of_a_name_is_found(catalog: Catalog, make_resource: MakeResource) -> None:
    catalog.create(make_resource(1, name="twin"), token=None)
    newest = catalog.create(make_resource(2, name="twin"), token=None)
    catalog.create(make_resource(3, kind="world", name="twin"), token=None)

    assert catalog.find("simulation-job", "twin") == newest
    assert catalog.find("simulation-job", "nobody") is None


def test_children_are_in_the_order_they_were_made(catalog: Catalog, make_resource: MakeResource) -> None:
    arns = [catalog.create(make_resource(n, kind="world", parent="arn:job"), token=None).arn for n in (3, 1, 2)]
    catalog.create(make_resource(4, kind="world", parent="arn:other"), token=None)

    assert [world.arn for world in catalog.children("arn:job", "world")] == arns


# Names and tokens


def test_a_unique_name_is_taken_once_for_each_kind(catalog: Catalog, make_resource: MakeResource) -> None:
    first = catalog.create(make_resource(1, name="app"), token=None, unique_name=True)

    with pytest.raises(ResourceAlreadyExistsException, match=f"{first.arn} already has the name 'app'"):
        catalog.create(make_resource(2, name="app"), token=None, unique_name=True)
    catalog.create(make_resource(3, kind="robot-application", name="app"), token=None, unique_name=True)
    catalog.delete(first.arn)
    catalog.create(make_resource(4, name="app"), token=None, unique_name=True)


def test_an_arn_is_taken_once(catalog: Catalog, make_resource: MakeResource) -> None:
    catalog.create(make_resource(1), token=None)

    with pytest.raises(ResourceAlreadyExistsException, match="already has that ARN"):
        catalog.create(make_resource(1), token=None)


def test_a_repeated_request_gets_the_resource_as_it_is_now(catalog: Catalog, make_resource: MakeResource) -> None:
    first = catalog.create(make_resource(1), token=token())
    moved = catalog.transition(first.arn, "prepare")

    assert catalog.create(make_resource(2), token=token()) == moved
    with pytest.raises(ResourceNotFoundException):
        catalog.get(make_resource(2).arn)


def test_a_token_is_for_one_request(catalog: Catalog, make_resource: MakeResource) -> None:
    first = catalog.create(make_resource(1), token=token())

    with pytest.raises(IdempotentParameterMismatchException, match=f"'t-1' was used for {first.arn}"):
        catalog.create(make_resource(2), token=token(request_hash="h-2"))
    other_account = make_resource(3, arn=make_resource(3).arn.replace("111122223333", "444455556666"))
    for new, used in ((make_resource(2), token(operation="CreateWorldExportJob")), (other_account, token())):
        assert catalog.create(new, token=used).arn == new.arn


def test_a_deleted_resource_frees_its_token(catalog: Catalog, make_resource: MakeResource) -> None:
    catalog.create(make_resource(1), token=token())
    catalog.delete(make_resource(1).arn)

    again = make_resource(2)

    assert catalog.create(again, token=token(request_hash="h-2")).arn == again.arn


def test_a_refused_name_leaves_the_token_unused(catalog: Catalog, make_resource: MakeResource) -> None:
    catalog.create(make_resource(1, name="app"), token=None, unique_name=True)
    with pytest.raises(ResourceAlreadyExistsException):
        catalog.create(make_resource(2, name="app"), token=token(), unique_name=True)

    new = make_resource(3, name="other")

    assert catalog.create(new, token=token(request_hash="h-2"), unique_name=True).arn == new.arn


def test_requests_are_told_apart_by_everything_but_their_token() -> None:
    def made(**members: Any) -> ClientToken:
        made_of = ClientToken.of("CreateWorldTemplate", CreateWorldTemplateRequest(templateBody="{}", **members))
        assert made_of is not None
        return made_of

    assert made(clientRequestToken="a").request_hash == made(clientRequestToken="b").request_hash
    assert made(clientRequestToken="a").request_hash != made(clientRequestToken="a", name="x").request_hash
    assert ClientToken.of("CreateWorldTemplate", CreateWorldTemplateRequest(templateBody="{}")) is None


# Lists


def test_pages_go_from_new_to_old_and_newcomers_do_not_shift_them(
    catalog: Catalog, make_resource: MakeResource
) -> None:
    arns = [catalog.create(make_resource(number), token=None).arn for number in range(5)]

    first = catalog.list("simulation-job", limit=2)
    catalog.create(make_resource(9), token=None)
    catalog.delete(arns[3])
    second = catalog.list("simulation-job", limit=2, after=first.next_token)
    third = catalog.list("simulation-job", limit=2, after=second.next_token)

    pages = [[resource.arn for resource in page.resources] for page in (first, second, third)]
    assert pages == [[arns[4], arns[3]], [arns[2], arns[1]], [arns[0]]]
    assert third.next_token is None


def test_a_full_last_page_has_no_token(catalog: Catalog, make_resource: MakeResource) -> None:
    for number in range(2):
        catalog.create(make_resource(number), token=None)

    assert catalog.list("simulation-job", limit=2).next_token is None
    assert catalog.list("world").resources == ()


def test_filters_are_alternatives_inside_and_conditions_together(catalog: Catalog, make_resource: MakeResource) -> None:
    for number, (name, status) in enumerate([("a", "Running"), ("a", "Failed"), ("b", "Failed"), ("a", "Pending")]):
        catalog.create(make_resource(number, name=name, status=status), token=None)

    page = catalog.list("simulation-job", filters={"name": ["a"], "status": ["Failed", "Running"]})

    assert [(found.name, found.status) for found in page.resources] == [("a", "Failed"), ("a", "Running")]


def test_a_page_token_is_for_its_own_list(catalog: Catalog, make_resource: MakeResource) -> None:
    for number in range(3):
        catalog.create(make_resource(number), token=None)
    page_token = catalog.list("simulation-job", limit=1).next_token
    assert page_token is not None

    with pytest.raises(InvalidParameterException, match="came from another list or other filters"):
        catalog.list("world", limit=1, after=page_token)
    with pytest.raises(InvalidParameterException, match="came from another list or other filters"):
        catalog.list("simulation-job", filters={"status": ["Pending"]}, limit=1, after=page_token)
    with pytest.raises(InvalidParameterException, match="came from another list or other filters"):
        catalog.list("simulation-job", limit=1, after=page_token, scope="ListSomethingElse")
    for wrong in ("nonsense", "ä", "", "MTI=", page_token + "="):
        with pytest.raises(InvalidParameterException, match="nextToken"):
            catalog.list("simulation-job", limit=1, after=wrong)


# Changes


def test_an_update_changes_the_document_and_counts(catalog: Catalog, make_resource: MakeResource, clock: Any) -> None:
    created = catalog.create(make_resource(1, document={"a": 1}), token=None)
    clock.advance(5)

    updated = catalog.update(created.arn, lambda document: {**document, "b": 2})

    assert updated == catalog.get(created.arn)
    assert (updated.document, updated.revision) == ({"a": 1, "b": 2}, 2)
    assert updated.updated_at - updated.created_at == timedelta(seconds=5)


def test_a_transition_follows_the_lifecycle(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, document={"a": 1}), token=None).arn

    prepared = catalog.transition(arn, "prepare", document_changes={"runId": "r"})

    assert prepared == catalog.get(arn)
    assert (prepared.status, prepared.document) == ("Preparing", {"a": 1, "runId": "r"})
    with pytest.raises(StateConflictError, match=f"{arn}: the simulation job is Preparing: 'complete' cannot happen"):
        catalog.transition(arn, "complete", document_changes={"a": 2})
    assert catalog.get(arn) == prepared


def test_what_has_no_lifecycle_has_no_transitions(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, kind="world", status="Active"), token=None).arn

    with pytest.raises(StateConflictError, match="is a world, which has no lifecycle"):
        catalog.transition(arn, "start")


def test_a_failing_change_changes_nothing(catalog: Catalog, make_resource: MakeResource) -> None:
    created = catalog.create(make_resource(1), token=None)

    with pytest.raises(KeyError):
        catalog.update(created.arn, lambda document: document["missing"])

    assert catalog.get(created.arn) == created


@ON_POSTGRESQL_ONLY
def test_a_change_meanwhile_is_not_overwritten(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, document={"n": 0}), token=None).arn
    seen = []

    def slow(document: dict[str, Any]) -> dict[str, Any]:
        seen.append(document["n"])
        if len(seen) == 1:
            catalog.update(arn, lambda other: {"n": other["n"] + 10})
        return {"n": document["n"] + 1}

    assert catalog.update(arn, slow).document == {"n": 11}
    assert seen == [0, 10]


@ON_POSTGRESQL_ONLY
def test_who_loses_the_lease_meanwhile_changes_nothing(
    catalog: Catalog, make_resource: MakeResource, clock: Any
) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    catalog.claim(arn, "slow", 10)

    def slow(document: dict[str, Any]) -> dict[str, Any]:
        clock.advance(20)
        assert catalog.claim(arn, "quick", 10)
        return {**document, "slow": True}

    with pytest.raises(StateConflictError, match="'slow' does not hold the lease; 'quick' does"):
        catalog.update(arn, slow, owner="slow")
    assert catalog.get(arn).document == {}


# Cancelling


def test_a_cancel_request_is_seen(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    assert catalog.cancel_requested(arn) is False

    catalog.request_cancel(arn)
    catalog.request_cancel(arn)

    assert catalog.cancel_requested(arn) is True
    assert catalog.transition(arn, "prepare").status == "Preparing"


def test_a_job_that_is_to_be_cancelled_cannot_complete_any_more(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, status="Terminating"), token=None).arn
    catalog.request_cancel(arn)

    with pytest.raises(StateConflictError, match="is to be cancelled; 'complete' cannot happen any more"):
        catalog.transition(arn, "complete")

    assert catalog.transition(arn, "cancel").status == "Canceled"


def test_what_has_ended_cannot_be_cancelled(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, status="Completed"), token=None).arn

    assert catalog.request_cancel(arn).status == "Completed"
    assert catalog.cancel_requested(arn) is False


# Leases


def test_a_lease_is_held_by_one_until_it_is_released(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1), token=None).arn

    assert catalog.claim(arn, "a", 30)
    assert catalog.claim(arn, "a", 30)
    assert not catalog.claim(arn, "b", 30)
    assert not catalog.release(arn, "b")
    assert catalog.release(arn, "a")
    assert catalog.claim(arn, "b", 30)


def test_a_lease_that_ran_out_can_be_taken(catalog: Catalog, make_resource: MakeResource, clock: Any) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    catalog.claim(arn, "a", 30)
    clock.advance(29.999)
    assert not catalog.claim(arn, "b", 30)
    clock.advance(0.001)

    assert catalog.claim(arn, "b", 30)
    assert not catalog.renew(arn, "a", 30)


def test_a_renewed_lease_lasts_longer(catalog: Catalog, make_resource: MakeResource, clock: Any) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    catalog.claim(arn, "a", 30)
    clock.advance(40)
    assert catalog.renew(arn, "a", 30)
    clock.advance(29)

    assert not catalog.claim(arn, "b", 30)


def test_a_worker_that_lost_its_lease_changes_nothing(
    catalog: Catalog, make_resource: MakeResource, clock: Any
) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    catalog.claim(arn, "a", 30)
    catalog.transition(arn, "prepare", owner="a")
    clock.advance(31)
    catalog.claim(arn, "b", 30)

    with pytest.raises(StateConflictError, match="'a' does not hold the lease; 'b' does"):
        catalog.transition(arn, "start", owner="a")
    with pytest.raises(StateConflictError, match="'a' does not hold the lease"):
        catalog.update(arn, lambda document: {"mine": True}, owner="a")
    assert catalog.transition(arn, "start", owner="b").document == {}


# Opening


def test_a_database_that_fails_is_said_to(url: str, clock: Any, make_resource: MakeResource) -> None:
    catalog = Catalog.open(url, clock=clock)
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE client_tokens"))
    engine.dispose()

    with pytest.raises(ServiceUnavailableException, match=r"the catalog .* does not answer: .*client_tokens"):
        catalog.create(make_resource(1), token=token())
    catalog.close()


def test_a_catalog_outlives_its_program(url: str, clock: Any, make_resource: MakeResource) -> None:
    first = Catalog.open(url, clock=clock)
    created = first.create(make_resource(1), token=token())
    first.close()

    second = Catalog.open(url, clock=clock)

    assert second.get(created.arn) == created
    assert second.create(make_resource(2), token=token()) == created
    second.close()


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("catalog.db", "'catalog.db' is no database URL; write sqlite:////"),
        ("postgresql//me:secret@host:port/x", "'postgresql//…@host:port/x' is no database URL"),
        ("sqlite://", "names no file"),
        ("sqlite:///:memory:", "names no file"),
        ("nosuch://host/db", "needs a driver that is not installed"),
    ],
)
def test_a_url_that_leads_nowhere_is_refused(url: str, expected: str, clock: Any) -> None:
    with pytest.raises(ConfigurationError, match=expected):
        Catalog.open(url, clock=clock)


def test_a_file_that_is_no_catalog_is_refused(tmp_path: Path, clock: Any) -> None:
    (tmp_path / "folder.db").mkdir()
    (tmp_path / "notes.txt").write_text("not a database " * 100)

    for name in ("folder.db", "notes.txt"):
        with pytest.raises(ConfigurationError, match=f"{name} cannot be opened: "):
            Catalog.open(f"sqlite:///{tmp_path}/{name}", clock=clock)


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        (99, f"has version 99, this program knows {FIRST_VERSION}; update this program"),
        (
            FIRST_VERSION - 1,
            "of a state before the first release; keep it for the program that made it, and use another",
        ),
    ],
)
def test_a_catalog_of_another_program_is_refused(version: int, expected: str, url: str, clock: Any) -> None:
    Catalog.open(url, clock=clock).close()
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text(f"UPDATE schema_version SET version = {version}"))
    engine.dispose()

    with pytest.raises(ConfigurationError, match=expected):
        Catalog.open(url, clock=clock)


def test_a_migration_changes_a_catalog_once(url: str, clock: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    Catalog.open(url, clock=clock).close()
    migrated: list[str] = []
    monkeypatch.setattr(database, "MIGRATIONS", (lambda connection: migrated.append(connection.dialect.name),))
    for _ in range(2):
        Catalog.open(url, clock=clock).close()
    assert len(migrated) == 1
    monkeypatch.undo()
    with pytest.raises(ConfigurationError, match=f"has version {FIRST_VERSION + 1}, this program knows"):
        Catalog.open(url, clock=clock)
