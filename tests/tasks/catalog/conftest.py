"""Catalogs to test with: SQLite in a temporary folder, and PostgreSQL where one is given.

Set ROBOMAKER_TEST_POSTGRES_URL (`postgresql+psycopg://…`, a database whose tables may be dropped)
to run everything on PostgreSQL as well.
"""

import os
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine

from prefect_robomaker.tasks.catalog import Catalog, NewResource, Resource
from prefect_robomaker.tasks.catalog.tables import metadata

POSTGRES_URL = os.environ.get("ROBOMAKER_TEST_POSTGRES_URL")
PREFIX = "arn:aws:robomaker:us-east-1:111122223333"


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = datetime(2025, 1, 2, 3, 4, 5, 678901, tzinfo=UTC)

    def __call__(self) -> datetime:
        return self.now

    def advance(self, seconds: float) -> None:
        self.now += timedelta(seconds=seconds)


MakeResource = Callable[..., NewResource]


def make_resource(number: int, kind: str = "simulation-job", **members: Any) -> NewResource:
    resource_id = f"sim-{number:012}"
    defaults = {"arn": f"{PREFIX}:{kind}/{resource_id}", "kind": kind, "id": resource_id, "status": "Pending"}
    return Resource.new(**{**defaults, **members})


@pytest.fixture(name="make_resource")
def _make_resource() -> MakeResource:
    return make_resource


@pytest.fixture
def clock() -> Clock:
    return Clock()


def _empty_database(kind: str, folder: Path) -> str:
    if kind == "sqlite":
        return f"sqlite:///{folder}/home/catalog.db"
    assert POSTGRES_URL is not None
    engine = create_engine(POSTGRES_URL)
    metadata.drop_all(engine)
    engine.dispose()
    return POSTGRES_URL


@pytest.fixture(scope="module", params=["sqlite", "postgresql"] if POSTGRES_URL else ["sqlite"])
def database(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def url(database: str, tmp_path: Path) -> str:
    return _empty_database(database, tmp_path)


@pytest.fixture(scope="module")
def shared_url(database: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """One database for all tests of a module that ask for it."""
    return _empty_database(database, tmp_path_factory.mktemp("catalog"))


@pytest.fixture
def catalog(url: str, clock: Clock) -> Iterator[Catalog]:
    opened = Catalog.open(url, clock=clock)
    yield opened
    opened.close()
