"""Tags of resources: merged up to a limit; lists find them by an index, also in catalogs from before there was one."""

from typing import Any

import pytest
from sqlalchemy import create_engine

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.catalog import Catalog
from prefect_robomaker.tasks.catalog.queries import list_query

JOB, BATCH = "simulation-job", "simulation-job-batch"


def listed(catalog: Catalog, *tags: str, kinds: Any = JOB, **filters: str) -> list[str]:
    wanted = {"tag": list(tags), **{name: [value] for name, value in filters.items()}}
    return [each.id[-1] for each in catalog.list(kinds, filters=wanted).resources]


def test_lists_find_a_tag_as_it_changes(catalog: Catalog, make_resource: Any) -> None:
    first, second = (
        catalog.create(make_resource(number, tags={"suite": "nightly", 'od"d=': f"{number}"}), token=None)
        for number in (1, 2)
    )
    catalog.create(make_resource(3, kind=BATCH, tags={"suite": "nightly"}), token=None)

    assert listed(catalog, "suite=nightly") == ["2", "1"]
    assert listed(catalog, "suite=nightly", status="Pending") == ["2", "1"]
    assert listed(catalog, "suite=nightly", status="Running") == []
    assert listed(catalog, "suite=nightly", kinds=(JOB, BATCH)) == ["3", "2", "1"]
    assert listed(catalog, "suite=other", "suite=nightly") == ["2", "1"]
    assert listed(catalog, "suite=night") == listed(catalog, "suite") == listed(catalog, "=nightly") == []

    catalog.set_tags(first.arn, {"suite": "weekly", "more": ""})
    catalog.remove_tags(second.arn, ["suite"])
    assert listed(catalog, "suite=nightly") == []
    assert listed(catalog, "suite=weekly") == listed(catalog, "more=") == ["1"]

    catalog.delete(first.arn)
    assert listed(catalog, "suite=weekly") == []
    catalog.create(make_resource(4, tags={"suite": "weekly"}), token=None)
    assert listed(catalog, "suite=weekly") == ["4"]


def test_pages_by_tag(catalog: Catalog, make_resource: Any) -> None:
    for number in range(5):
        catalog.create(make_resource(number, tags={"even": "no" if number % 2 else "yes"}), token=None)
    first = catalog.list(JOB, filters={"tag": ["even=yes"]}, limit=2)
    rest = catalog.list(JOB, filters={"tag": ["even=yes"]}, limit=2, after=first.next_token)
    assert [each.id[-1] for each in (*first.resources, *rest.resources)] == ["4", "2", "0"]
    assert rest.next_token is None


def test_a_tag_that_few_have_is_looked_up(url: str, clock: Any) -> None:
    """Whatever else is asked for: the rows of the tag are read, not those of the kind."""
    Catalog.open(url, clock=clock).close()
    engine = create_engine(url)
    for more in ({}, {"status": ["Completed"]}):
        query = list_query((JOB,), {"tag": ["rare=yes"], **more}, None, 50)
        compiled = query.compile(engine, compile_kwargs={"literal_binds": True})
        is_sqlite = engine.dialect.name == "sqlite"
        with engine.connect() as connection:
            plan = connection.exec_driver_sql(f"EXPLAIN {'QUERY PLAN' if is_sqlite else ''} {compiled}").fetchall()
        first = str(plan[0][-1] if is_sqlite else plan)
        assert "resource_tags" in first, plan
    engine.dispose()


def test_tags_are_merged_and_removed(catalog: Catalog, make_resource: Any, clock: Any) -> None:
    created = catalog.create(make_resource(1, tags={"a": "1", "b": "2"}), token=None)
    arn = created.arn
    clock.advance(60)

    assert catalog.set_tags(arn, {"b": "3", "c": ""}).tags == {"a": "1", "b": "3", "c": ""}
    assert catalog.remove_tags(arn, ["a", "unknown"]).tags == catalog.get(arn).tags == {"b": "3", "c": ""}
    assert catalog.get(arn).updated_at == created.updated_at


def test_a_resource_has_at_most_fifty_tags(catalog: Catalog, make_resource: Any) -> None:
    arn = catalog.create(make_resource(1, tags={f"k{n}": "" for n in range(50)}), token=None).arn

    assert catalog.set_tags(arn, {"k0": "new"}).tags["k0"] == "new"
    with pytest.raises(InvalidParameterException, match="would have 51 tags"):
        catalog.set_tags(arn, {"one": "more"})
    assert len(catalog.get(arn).tags) == 50
