"""Object key of a world export job's archive; apart from the exporter, which needs MuJoCo."""

import re

_EXPORT_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9\-]{0,63}")


def export_key(prefix: str, export_id: str) -> str:
    """Returns the object-store key of a world export job's archive.

    Args:
        prefix: the output location's prefix; may be empty.
        export_id: the export job's id, with or without `export-` in front.

    Raises:
        ValueError: that is no id.
    """
    bare_id = export_id.removeprefix("export-")
    if not _EXPORT_ID.fullmatch(bare_id):
        raise ValueError(f"export id {export_id!r}: expected something like 'export-82856b0yq33y'")
    name = f"aws-robomaker-worldforge-export-{bare_id}.zip"
    return f"{prefix.strip('/')}/{name}" if prefix.strip("/") else name
