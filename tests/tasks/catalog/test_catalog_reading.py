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
