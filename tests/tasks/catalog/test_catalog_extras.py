"""Labels, numbered children, and what is left to do."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import (
    InvalidParameterException,
    LimitExceededException,
    ResourceNotFoundException,
    StateConflictError,
)
from prefect_robomaker.tasks.catalog import Catalog, NewResource, Resource

MakeResource = Callable[..., NewResource]
VERSION = "robot-application-version"


def ids(page: Any) -> list[str]:
    return [found.id[-1] for found in page.resources]


# Labels


def test_lists_find_resources_by_their_labels(catalog: Catalog, make_resource: MakeResource) -> None:
    for number, robots in enumerate([["scout"], ["spot", "scout"], ["spot"], []]):
        catalog.create(make_resource(number, labels={"robot": robots}), token=None)
    catalog.create(make_resource(5, kind="world-export-job", labels={"robot": ["scout"]}), token=None)

    assert ids(catalog.list("simulation-job", filters={"robot": ["scout"]})) == ["1", "0"]
    assert ids(catalog.list("simulation-job", filters={"robot": ["scout", "spot"]})) == ["2", "1", "0"]
    assert ids(catalog.list("simulation-job", filters={"robot": ["scout"], "status": ["Failed"]})) == []
    assert ids(catalog.list("simulation-job", filters={"colour": ["scout"]})) == []


def test_labels_are_replaced_and_go_with_their_resource(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, labels={"robot": ["scout"], "world": ["w"]}), token=None).arn

    changed = catalog.update(arn, lambda document: document, labels={"robot": ["spot", "spot"]})

    assert changed.labels == catalog.get(arn).labels == {"robot": ["spot", "spot"]}
    assert ids(catalog.list("simulation-job", filters={"robot": ["scout"]})) == []
    assert ids(catalog.list("simulation-job", filters={"robot": ["spot"]})) == ["1"]
    catalog.delete(arn)
    catalog.create(make_resource(2), token=None)
    assert ids(catalog.list("simulation-job", filters={"robot": ["spot"]})) == []


def test_pages_of_a_label_have_every_resource_once(catalog: Catalog, make_resource: MakeResource) -> None:
    for number in range(7):
        catalog.create(make_resource(number, labels={"robot": ["scout"]}), token=None)
    found, after = [], None
    while not found or after:
        page = catalog.list("simulation-job", filters={"robot": ["scout"]}, limit=3, after=after)
        found += ids(page)
        after = page.next_token

    assert found == list("6543210")


def test_several_kinds_are_listed_together(catalog: Catalog, make_resource: MakeResource) -> None:
    for number, kind in enumerate(["robot", "deployment-fleet", "robot", "world"]):
        catalog.create(make_resource(number, kind=kind), token=None)

    assert ids(catalog.list(("robot", "deployment-fleet"))) == ["2", "1", "0"]


# Names, status


def test_an_update_may_rename_and_set_a_status(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, kind="robot", name="a", status="Available"), token=None).arn
    job = catalog.create(make_resource(2), token=None).arn

    changed = catalog.update(arn, lambda document: document, name="b", status="Registered")

    assert (changed.name, changed.status) == ("b", "Registered")
    assert catalog.get(arn) == changed
    with pytest.raises(StateConflictError, match="changes by events only"):
        catalog.update(job, lambda document: document, status="Running")


# Children


def version(parent: Resource, number: int) -> NewResource:
    arn = f"{parent.arn}/version/{number}"
    return Resource.new(
        arn=arn, kind=VERSION, id=arn[-20:], name=parent.name, parent=parent.arn, document={"n": number}
    )


def test_numbers_are_never_used_again(catalog: Catalog, make_resource: MakeResource) -> None:
    parent = catalog.create(make_resource(1, kind="robot-application", name="nav", document={"a": 1}), token=None)
    made = [catalog.create_numbered(parent.arn, version, most=3) for _ in range(2)]
    catalog.delete(made[1].arn)

    third = catalog.create_numbered(parent.arn, version, most=3)

    assert third.document == {"n": 3}
    assert catalog.get(parent.arn).document == {"a": 1, "lastNumber": 3}
    assert [child.document["n"] for child in catalog.children(parent.arn, kind=VERSION)] == [1, 3]


def test_there_are_at_most_so_many_numbered_children(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, kind="robot-application"), token=None).arn
    for _ in range(2):
        catalog.create_numbered(arn, version, most=2)

    with pytest.raises(LimitExceededException, match="has 2 of at most 2"):
        catalog.create_numbered(arn, version, most=2)
    assert catalog.get(arn).document["lastNumber"] == 2


def test_a_child_that_cannot_be_made_takes_no_number(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, kind="robot-application"), token=None).arn

    def refuse(parent: Resource, number: int) -> NewResource:
        raise InvalidParameterException("not this one")

    with pytest.raises(InvalidParameterException, match="not this one"):
        catalog.create_numbered(arn, refuse, most=2)
    assert catalog.create_numbered(arn, version, most=2).document == {"n": 1}
    with pytest.raises(ResourceNotFoundException):
        catalog.create_numbered(arn + "x", version, most=2)


def test_threads_get_numbers_of_their_own(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, kind="robot-application"), token=None).arn
    together = threading.Barrier(8)

    def make(_: int) -> int:
        together.wait()
        return catalog.create_numbered(arn, version, most=40).document["n"]

    with ThreadPoolExecutor(8) as pool:
        assert sorted(pool.map(make, range(8))) == list(range(1, 9))


def test_children_go_with_their_parent_if_asked(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1, kind="robot-application"), token=None).arn
    child = catalog.create_numbered(arn, version, most=2).arn
    other = catalog.create(make_resource(2, parent=arn), token=None).arn

    catalog.delete(arn, children=[VERSION])

    assert catalog.get_many([arn, child, other]).keys() == {other}


# What is left to do


def test_unfinished_jobs_are_those_that_no_worker_holds(
    catalog: Catalog, make_resource: MakeResource, clock: Any
) -> None:
    arns = [catalog.create(make_resource(number), token=None).arn for number in range(4)]
    catalog.create(make_resource(4, status="Completed"), token=None)
    catalog.create(make_resource(5, kind="world"), token=None)
    catalog.claim(arns[0], "me", 30)
    catalog.claim(arns[1], "you", 10)
    clock.advance(20)

    assert [job.arn for job in catalog.unfinished(["simulation-job", "world-export-job"])] == arns[1:]
    assert [job.arn for job in catalog.unfinished(["simulation-job"], limit=1)] == [arns[1]]
    assert catalog.unfinished(["world-export-job"]) == ()


def test_resources_are_counted_by_kind_and_status(catalog: Catalog, make_resource: MakeResource) -> None:
    for number, status in enumerate(["Pending", "Failed", "Failed"]):
        catalog.create(make_resource(number, status=status), token=None)
    catalog.create(make_resource(3, kind="world", status="Active"), token=None)

    assert catalog.count() == {"simulation-job": {"Pending": 1, "Failed": 2}, "world": {"Active": 1}}


def test_labels_survive_reopening(url: str, clock: Any, make_resource: MakeResource, tmp_path: Path) -> None:
    first = Catalog.open(url, clock=clock)
    arn = first.create(make_resource(1, labels={"robot": ["scout"]}), token=None).arn
    first.close()
    second = Catalog.open(url, clock=clock)

    assert second.get(arn).labels == {"robot": ["scout"]}
    second.close()
