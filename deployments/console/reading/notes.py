"""Notes that a run's process leaves on this machine for pages that show it."""

from pathlib import Path

from ....schemas.wire.globs import Glob
from ....tasks.runtime.limits.left_files import open_left
from ....tasks.simulations.outputs.upload_files import visit_matches

_APPLICATION_FOLDER = "work"  # below that of the run


def note_of(run: Path | None, name: str, most_bytes: int) -> bytes:
    """Reads a note from the application's own files. No link is followed, and the content is not trusted.

    Args:
        run: the folder of the run; `None`: it is not on this machine.
        name: of the note.
        most_bytes: what of it is read.

    Returns:
        Its first bytes; none where it cannot be read.
    """
    found: list[bytes] = []

    def read(folder: int, file_name: str, _: str) -> None:
        try:
            with open_left(Path(file_name), folder) as file:
                found.append(file.read(most_bytes))
        except OSError:
            return

    if run is not None:
        visit_matches(run, Glob(f"/{_APPLICATION_FOLDER}/{name}"), read)
    return b"".join(found)
