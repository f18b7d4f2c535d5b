"""Places of the archives of world export jobs; apart from the exporter, which needs MuJoCo."""

from ...schemas.documents.worlds import WorldExportJobDocument
from ..catalog import Resource
from ..worldforge.exports.export_key import export_key


def archive_place(job: Resource) -> tuple[str, str]:
    """Returns bucket and key of a world export job's archive."""
    location = WorldExportJobDocument.of(job).request.output_location
    return location.s3_bucket, export_key(location.s3_prefix or "", job.id)
