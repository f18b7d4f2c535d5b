"""Where the archives of world export jobs are stored; apart from the exporter, which needs MuJoCo."""

from ..catalog import Resource
from ..worldforge.exports.export_key import export_key


def archive_place(job: Resource) -> tuple[str, str]:
    """Bucket and key of an export job's archive."""
    location = job.document["request"]["outputLocation"]
    return location["s3Bucket"], export_key(location.get("s3Prefix") or "", job.id)
