"""Catalogs from before there were labels: their worlds and jobs get the ones they would have today."""

from typing import Any

from sqlalchemy import create_engine, text

from prefect_robomaker.tasks.catalog import Catalog, Resource

PREFIX = "arn:aws:robomaker:us-east-1:111122223333"
TEMPLATE = f"{PREFIX}:world-template/template-1"
GENERATION = f"{PREFIX}:world-generation-job/generation-1"
WORLD = f"{PREFIX}:world/generation-1/world-1"
EXPORT = f"{PREFIX}:world-export-job/export-1"
GONE = f"{PREFIX}:world/generation-0/world-1"
BUNDLE = {"bucket": "robomaker", "prefix": "worlds/abc"}
ROWS: tuple[tuple[str, str | None, dict[str, Any]], ...] = (
    (GENERATION, None, {"request": {"template": TEMPLATE}}),
    (WORLD, GENERATION, {"template": TEMPLATE, "bundle": BUNDLE}),
    (EXPORT, None, {"request": {"worlds": [GONE, WORLD, WORLD]}}),
    (f"{PREFIX}:simulation-job/sim-1", None, {"request": {}}),
)


def test_worlds_and_their_jobs_are_labelled_when_the_catalog_is_opened(url: str, clock: Any) -> None:
    first = Catalog.open(url, clock=clock)
    for arn, parent, document in ROWS:
        kind, _, name = arn.rpartition(":")[2].partition("/")
        first.create(Resource.new(arn=arn, kind=kind, id=name, parent=parent, document=document), token=None)
    first.close()
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE resources SET labels = NULL"))
        connection.execute(text("DELETE FROM schema_version WHERE version > 3"))
    engine.dispose()

    catalog = Catalog.open(url, clock=clock)

    def listed(kind: str, **labels: str) -> list[str]:
        page = catalog.list(kind, filters={key: [value] for key, value in labels.items()})
        return [resource.arn for resource in page.resources]

    assert listed("world-generation-job", templateId="template-1") == [GENERATION]
    assert listed("world", templateId="template-1") == [WORLD]
    assert listed("world", generationJobId="generation-1") == [WORLD]
    assert listed("world", bundle="robomaker/worlds/abc") == [WORLD]
    assert listed("world-export-job", generationJobId="generation-1") == [EXPORT]
    assert listed("world-export-job", templateId="template-1") == [EXPORT]
    assert catalog.get(WORLD).labels["generationJobId"] == ["generation-1"]
    catalog.close()
