"""The journal of a job's trials: a line of JSON for each that has finished.

A Parquet file can be read only once it is whole; the journal stays readable however its process ends, and the table
is made from it.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

from pydantic import ValidationError

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.trial_rows import TrialRow
from ..limits.left_files import open_left

JOURNAL_FILE = "trials.jsonl"
_MAX_LINE_BYTES = 1024 * 1024

TakeRow = Callable[[TrialRow], None]
"""Takes in one row."""


def journal_path(plan: RunPlan) -> Path:
    """Returns the path of a run's journal: with its checkpoints, if it has any."""
    return (plan.checkpoint_dir or plan.work_dir) / JOURNAL_FILE


def read_journal(path: Path) -> Iterator[TrialRow]:
    """Reads the rows of a journal one by one, up to the first that is not whole or out of turn; none if it is absent.

    Raises:
        OSError: It cannot be read, or is a link or something else than a file.
    """
    for row, _ in _rows(path):
        yield row


class TrialJournal:
    """Appends rows; each is in the operating system's hands, which a kill does not undo, before the next trial."""

    def __init__(self, path: Path, take: TakeRow) -> None:
        """Opens a journal, to go on after its last whole row.

        Args:
            path: The file; made with its folder unless it exists.
            take: Told of each row that is there already.

        Raises:
            OSError: It cannot be read or written.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.rows, size_bytes = 0, 0
        """How many there are."""
        for row, end in _rows(path):
            take(row)
            self.rows, size_bytes = self.rows + 1, end
        self._file = path.open("ab", buffering=0)
        self._file.truncate(size_bytes)

    def append(self, row: TrialRow) -> None:
        """Adds a row.

        Raises:
            OSError: The disk is full, for one.
        """
        line = row.model_dump_json(exclude_defaults=True).encode() + b"\n"
        if self._file.write(line) != len(line):
            raise OSError(f"{self._file.name} cannot be written to its end; the disk may be full")
        self.rows += 1

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def _rows(path: Path) -> Iterator[tuple[TrialRow, int]]:
    """The rows, each with the place where it ends."""
    try:
        file = open_left(path)
    except FileNotFoundError:
        return
    place = 0
    with file:
        for number, line in enumerate(iter(lambda: file.readline(_MAX_LINE_BYTES), b"")):
            try:
                row = TrialRow.model_validate_json(line)
            except ValidationError:  # cut off by a kill, or an application wrote to it
                return
            if row.trial != number or not line.endswith(b"\n"):
                return
            place += len(line)
            yield row, place
