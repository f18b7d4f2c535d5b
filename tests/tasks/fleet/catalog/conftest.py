"""Catalogs to test with."""

from helpers.empty_catalogs import (  # noqa: F401 - fixtures
    _make_resource,
    catalog,
    clock,
    database,
    empty_catalog,
    new_database,
    postgres_tables,
    url,
)
