"""What jobs and their lists read: where a job stands, few members of large documents, children of many parents."""

from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Catalog, NewResource

MakeResource = Callable[..., NewResource]
BATCH = "simulation-job-batch"


def test_where_a_resource_stands_is_read_without_its_document(catalog: Catalog, make_resource: MakeResource) -> None:
    arn = catalog.create(make_resource(1), token=None).arn
    assert catalog.standing(arn) == ("Pending", False)

    catalog.transition(arn, "prepare")
    catalog.request_cancel(arn)

    assert catalog.standing(arn) == ("Preparing", True)
    with pytest.raises(ResourceNotFoundException, match="no-such"):
        catalog.standing("arn:aws:robomaker:us-east-1:000000000000:simulation-job/no-such")


def test_a_list_reads_only_the_members_that_are_wanted(catalog: Catalog, make_resource: MakeResource) -> None:
    document: dict[str, Any] = {"count": 3, "failed": {"0": "x"}, "request": ["large"] * 1000}
    for number in range(3):
        catalog.create(make_resource(number, kind=BATCH, tags={"a": "b"}, document=document), token=None)

    page = catalog.list(BATCH, limit=2, members=["count", "failed", "nothing"])

    assert [resource.document for resource in page.resources] == [{"count": 3, "failed": {"0": "x"}}] * 2
    assert [resource.tags for resource in page.resources] == [{"a": "b"}] * 2
    rest = catalog.list(BATCH, limit=2, members=["count"], after=page.next_token)
    assert [resource.id for resource in rest.resources] == [make_resource(0).id]


def test_children_of_several_parents_are_counted_at_once(catalog: Catalog, make_resource: MakeResource) -> None:
    parents = [catalog.create(make_resource(number, kind=BATCH), token=None).arn for number in (1, 2, 3)]
    for number, parent in enumerate([parents[0], parents[0], parents[1]]):
        catalog.create(make_resource(10 + number, parent=parent), token=None)
    catalog.create(make_resource(20, kind="world", parent=parents[2]), token=None)

    assert catalog.count_each(parents, "simulation-job") == {parents[0]: 2, parents[1]: 1}
    assert catalog.count_each([], "simulation-job") == {}


def test_the_newest_that_stand_somehow_are_found_by_kind(catalog: Catalog, make_resource: MakeResource) -> None:
    batch = catalog.create(make_resource(1, kind=BATCH, document={"count": 3}), token=None)
    alone = [catalog.create(make_resource(number), token=None).arn for number in (2, 3, 4)]
    catalog.create(make_resource(5, parent=batch.arn), token=None)
    catalog.create(make_resource(6, status="Completed"), token=None)
    catalog.create(make_resource(7, kind="world", parent="arn:aws:a:b:c:fleet/d", status="Pending"), token=None)
    wanted = {BATCH: ["Pending"], "simulation-job": ["Pending", "Running"], "world": ["Pending"]}

    found = catalog.newest(wanted, not_below=BATCH, limit=2, members=["count"])

    assert [each.arn for each in found if each.kind == "simulation-job"] == [alone[2], alone[1]]
    assert [each.document for each in found if each.kind != "simulation-job"] == [{}, {"count": 3}]


def test_some_members_of_several_are_read(catalog: Catalog, make_resource: MakeResource) -> None:
    document: dict[str, Any] = {"a": 0, "b": False, "c": {"d": ['"']}, "e": None, "it's": "x"}
    arn = catalog.create(make_resource(1, document=document), token=None).arn

    for members in ([], ["a"], ["b", "c", "e", "it's", "none"]):
        wanted = {name: document[name] for name in members if document.get(name) is not None}
        assert catalog.get_many([arn, "arn:none"], members)[arn].document == wanted


def test_resources_are_found_by_the_ends_of_their_ids(catalog: Catalog, make_resource: MakeResource) -> None:
    ids = [catalog.create(make_resource(number), token=None).id for number in range(12)]
    other = catalog.create(make_resource(30, kind="world"), token=None).id
    kind = "simulation-job"
    assert [each.id for each in catalog.with_ids(kind, ids[3], limit=9)] == [ids[3]]
    assert [each.id for each in catalog.with_ids(kind, ids[3][:4], limit=2)] == [ids[11], ids[10]], "newest first"
    assert [each.id for each in catalog.with_ids(kind, ids[3][:4], ids[3][-1], limit=9)] == [
        each for each in reversed(ids) if each.endswith(ids[3][-1])
    ]
    assert catalog.with_ids(kind, other, limit=9) == ()
    for wild in ("%", "_" * len(ids[0]), f"{ids[0][:-1]}_"):
        assert catalog.with_ids(kind, wild, limit=9) == (), "no pattern"
