"""Catalogs to test with: on SQLite in a temporary folder, and on a PostgreSQL server of the tests' own."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime, timedelta
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from sqlalchemy import create_engine, inspect, text
from sqlalchemy.pool import NullPool

from helpers.postgres_server import NEEDS_POSTGRESQL
from prefect_robomaker.tasks.catalog import Catalog, NewResource, Resource

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
NewDatabase = Callable[[], AbstractContextManager[str]]


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


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgresql", marks=NEEDS_POSTGRESQL)])
def database(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def new_database(request: pytest.FixtureRequest, database: str) -> NewDatabase:
    """Makes empty databases: the URL of one for each `with`."""
    return _sqlite_file if database == "sqlite" else request.getfixturevalue("postgres_server").new_database


@contextmanager
def _sqlite_file() -> Iterator[str]:
    with TemporaryDirectory(prefix="catalog-") as folder:
        yield f"sqlite:///{folder}/home/catalog.db"


@pytest.fixture
def url(new_database: NewDatabase) -> Iterator[str]:
    with new_database() as url:
        yield url


@pytest.fixture(scope="session")
def postgres_tables(request: pytest.FixtureRequest) -> Iterator[str]:
    """The URL of a database on PostgreSQL with the tables of a catalog, which tests empty: to make one takes longer."""
    with request.getfixturevalue("postgres_server").new_database() as url:
        Catalog.open(url, clock=Clock()).close()
        yield url


@pytest.fixture(scope="module")
def empty_catalog(request: pytest.FixtureRequest, database: str) -> NewDatabase:
    """The URL of a catalog with nothing in it, for each `with`: on PostgreSQL the same one, so one at a time."""
    if database == "sqlite":
        return _sqlite_file
    url: str = request.getfixturevalue("postgres_tables")
    return lambda: _emptied(url)


@contextmanager
def _emptied(url: str) -> Iterator[str]:
    kept = {"schema_version"}
    engine = create_engine(url, poolclass=NullPool)
    with engine.begin() as connection:
        names = [name for name in inspect(connection).get_table_names() if name not in kept]
        connection.execute(text(f"TRUNCATE {', '.join(names)} RESTART IDENTITY CASCADE"))
    yield url


@pytest.fixture
def catalog(empty_catalog: NewDatabase, clock: Clock) -> Iterator[Catalog]:
    with empty_catalog() as url:
        opened = Catalog.open(url, clock=clock)
        yield opened
        opened.close()
