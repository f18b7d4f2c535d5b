"""Specifications that Prefect deployments keep, for `robomaker gc`: it removes nothing that they name."""

import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ...schemas.settings import Settings
from ...tasks.retention.stored_specifications import PIPELINE, StoredSpecification
from ..prefect_database import database_file, read_deployments
from ..prefect_server.local_server import client_variables, is_at_own_port, server_status

if TYPE_CHECKING:
    from prefect.client.orchestration import SyncPrefectClient

_PAGE = 200
"""Limit of the deployments that the server returns at once."""


def stored_deployments(settings: Settings) -> list[StoredSpecification | str]:
    """Lists what deployments run, of the local Prefect server and of the one that is configured.

    The local server need not run: its database is read.

    Args:
        settings: Settings of the data home with the local server.

    Returns:
        The specifications; for a server that does not answer, a text that says so.
    """
    found: list[StoredSpecification | str] = []
    path = database_file(settings)
    if path.is_file():
        try:
            for flow, name, parameters in read_deployments(path):
                found += _stored(flow, name, parameters)
        except (sqlite3.Error, ValueError) as error:
            found.append(f"the deployments in {path} cannot be read ({error})")
    status = server_status(settings)
    url = str(status.api_url)
    if not status.configured_elsewhere or is_at_own_port(url, settings):  # its database has just been read
        return found
    try:
        with _client(url, settings) as client:
            found += _asked(client)
    except Exception as error:  # whatever Prefect's client raises: deployments that are not known may name anything
        found.append(f"the Prefect server at {url} does not tell its deployments ({type(error).__name__})")
    return found


def _stored(flow: str, name: str, parameters: list[dict[str, Any]]) -> Iterator[StoredSpecification]:
    """Yields what a deployment runs with its own parameters, and with those of each of its schedules."""
    own = parameters[0]
    for each in ({}, *parameters[1:]):
        # As a whole in one parameter, or each by its name: see the form of a specification's parameters.
        given = {**own, **each}
        inner = given.pop("parameters", None)
        values = {**(inner if isinstance(inner, dict) else {}), **given}
        yield StoredSpecification(f"the deployment {flow}/{name}", values, is_pipeline=flow == PIPELINE)


def _asked(client: "SyncPrefectClient") -> Iterator[StoredSpecification]:
    flows: dict[object, str] = {}
    offset = 0
    while page := client.read_deployments(limit=_PAGE, offset=offset):
        offset += len(page)
        for each in page:
            if each.flow_id not in flows:
                flows[each.flow_id] = client.read_flow(each.flow_id).name
            parameters = [dict(each.parameters), *(dict(schedule.parameters or {}) for schedule in each.schedules)]
            yield from _stored(flows[each.flow_id], each.name, parameters)


@contextmanager
def _client(api_url: str, settings: Settings) -> "Iterator[SyncPrefectClient]":
    from prefect.client.orchestration import get_client
    from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

    variables: Mapping[str, str] = client_variables(api_url, settings, os.environ)
    chosen: dict[Any, Any] = {PREFECT_API_URL: api_url}
    if secret := variables.get("PREFECT_API_AUTH_STRING"):
        chosen[PREFECT_API_AUTH_STRING] = secret
    with temporary_settings(chosen), get_client(sync_client=True) as client:
        yield client
