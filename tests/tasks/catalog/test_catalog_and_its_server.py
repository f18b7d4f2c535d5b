"""A catalog on PostgreSQL whose server crashes, restarts, or is away for a while."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import pytest
from helpers.postgres_server import NEEDS_POSTGRESQL, PostgresServer

from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.catalog import Catalog, NewResource


@NEEDS_POSTGRESQL
def test_while_its_server_is_away_a_catalog_says_so(
    postgres_server: PostgresServer, postgres_database: str, make_resource: Callable[..., NewResource]
) -> None:
    catalog = Catalog.open(postgres_database, clock=lambda: datetime.now(UTC))
    arn = catalog.create(make_resource(1), token=None).arn

    postgres_server.stop()

    with pytest.raises(ServiceUnavailableException, match=r"the catalog .* does not answer"):
        catalog.get(arn)
    postgres_server.start()
    assert catalog.get(arn).arn == arn
    catalog.close()


@NEEDS_POSTGRESQL
def test_a_catalog_goes_on_after_its_server_crashed_and_came_back(
    postgres_server: PostgresServer, postgres_database: str, make_resource: Callable[..., NewResource]
) -> None:
    def add(number: int, document: dict[str, Any]) -> dict[str, Any]:
        return {"n": document["n"] + number}

    catalog = Catalog.open(postgres_database, clock=lambda: datetime.now(UTC))
    arn = catalog.create(make_resource(1, document={"n": 0}), token=None).arn
    catalog.update(arn, lambda document: add(1, document))

    postgres_server.kill()
    postgres_server.start()

    assert catalog.get(arn).document == {"n": 1}
    catalog.update(arn, lambda document: add(2, document))
    postgres_server.restart()
    assert catalog.get(arn).document == {"n": 3}
    catalog.close()
