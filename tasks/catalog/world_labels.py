"""Labels for worlds and their jobs in catalogs that were made before there were labels.

Lists filter by them, and deleting a world looks up by them which other worlds share its stored bundle.
"""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, null, select, update

from .queries import insert_labels
from .tables import resources

_KINDS = ("world", "world-generation-job", "world-export-job")


def label_worlds(connection: Connection) -> None:
    """Gives every world, generation job and export job without labels those it would be created with today."""
    columns = (resources.c.sequence, resources.c.arn, resources.c.kind, resources.c.parent, resources.c.document)
    query = select(*columns).where(resources.c.kind.in_(_KINDS), resources.c.labels.is_(null()))
    origins: dict[str, dict[str, list[str]]] = {}
    for row in connection.execute(query.order_by(resources.c.sequence)).mappings().all():
        if row["kind"] == "world-export-job":
            labels = _of_export(row["document"], origins)
        else:
            labels = _of_origin(row["parent"], row["document"])
            origins[row["arn"]] = {key: values for key, values in labels.items() if key != "bundle"}
        connection.execute(update(resources).where(resources.c.sequence == row["sequence"]).values(labels=labels))
        insert_labels(connection, row["sequence"], labels)


def _of_origin(parent: str | None, document: Mapping[str, Any]) -> dict[str, list[str]]:
    """The labels of a world or a generation job."""
    labels: dict[str, list[str]] = {}
    if parent is not None:
        labels["generationJobId"] = [_id(parent)]
    if template := document.get("template") or document.get("request", {}).get("template"):
        labels["templateId"] = [_id(template)]
    if bundle := document.get("bundle"):
        labels["bundle"] = [f"{bundle['bucket']}/{bundle['prefix']}"]
    return labels


def _of_export(document: Mapping[str, Any], origins: Mapping[str, Mapping[str, list[str]]]) -> dict[str, list[str]]:
    """The labels of an export job: those of its worlds, as far as they exist."""
    labels: dict[str, list[str]] = {}
    for world in document.get("request", {}).get("worlds", ()):
        for key, values in origins.get(world, {}).items():
            labels[key] = list(dict.fromkeys([*labels.get(key, ()), *values]))
    return labels


def _id(arn: str) -> str:
    return arn.rpartition("/")[2]
