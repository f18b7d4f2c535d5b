"""Object-store keys of world export archives; separate from the exporter, which needs MuJoCo."""

import re

from ...schemas.documents.worlds import WorldExportJobDocument
from ..catalog import Resource

_EXPORT_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9\-]{0,63}")


def archive_place(job: Resource) -> tuple[str, str]:
    """Returns bucket and key of a world export job's archive."""
    location = WorldExportJobDocument.of(job).request.output_location
    return location.s3_bucket, export_key(location.s3_prefix or "", job.id)


def export_key(prefix: str, export_id: str) -> str:
    """Returns the object-store key of a world export job's archive.

    Args:
        prefix: The output location's prefix; may be empty.
        export_id: The export job's id, with or without `export-` in front.

    Raises:
        ValueError: The id is malformed.
    """
    bare_id = export_id.removeprefix("export-")
    if not _EXPORT_ID.fullmatch(bare_id):
        raise ValueError(f"export id {export_id!r}: expected something like 'export-82856b0yq33y'")
    name = f"aws-robomaker-worldforge-export-{bare_id}.zip"
    return f"{prefix.strip('/')}/{name}" if prefix.strip("/") else name
