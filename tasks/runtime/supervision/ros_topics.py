"""Recorded topics of ROS 2 nodes after a run: merges them with the run's recording, and adds notes to its result."""

import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import TOPIC_RECORDER
from ...files.untrusted_files import read_left, unfinished_of
from ..limits.logs import LOG_FOLDER, add_note, log_tail
from ..ros.topic_report import (
    MAX_REPORT_BYTES,
    RecorderReport,
    losses_of,
    notes_of,
    part_path,
    report_path,
    unrecorded_commands,
)
from .finished_outputs import add_result_notes, read_result
from .helper_programs import MAX_REASON_CHARACTERS, run_helper

_JOINING = "prefect_robomaker.tasks.runtime.ros.joining"
_PART = re.compile(r"ros-topics\.([1-9][0-9]{0,5})\.mcap")
_REPORT_SUFFIX = ".json"
BAG_FILE = f"{TOPIC_RECORDER}.bag"
"""File name of the recording of ROS 1 topics."""
_JOINED = ("recording.mcap", "metadata.yaml", "foxglove-layout.json")
"""Names of the files that merging rewrites."""
_BLOCK_BYTES = 512
"""Unit of `st_blocks` on Linux in bytes, on every file system."""
_LIMIT_S = 60.0
"""Wall-clock limit of merging in seconds, plus a time for the size of the files."""
_BYTES_A_SECOND = 10 * 1024 * 1024
"""Bytes that are merged in a second, for the time limit: a tenth of the measured speed on two busy processors."""
_CANCELED_LIMIT_S = 20.0
"""Wall-clock limit of merging in seconds after a cancelled run, as a person may be waiting for its end."""


def join_ros_topics(
    plan: RunPlan, *, is_canceled: bool, stop: Callable[[], str | None], environment: Mapping[str, str]
) -> dict[str, str]:
    """Merges the ROS topics recorded by a run's recorder into the run's own recording.

    If merging fails, the run's outcome does not change: the files stay separate, and the result gets a note.

    Args:
        plan: Plan of the run; its processes have ended, and its result, if any, is written.
        is_canceled: Whether the run was cancelled, so that `stop` returns a reason already.
        stop: Function called about every 0.1 s; a result other than None ends the merging.
        environment: Environment variables of the merging process.

    Returns:
        Why topics are not in the recording as a whole, by their names.
    """
    program = next((each.name for each in plan.programs if each.name.endswith(f".{TOPIC_RECORDER}")), None)
    folder = plan.output_dir
    if program is None:
        with suppress(OSError):
            why = read_left(folder / LOG_FOLDER / f"{TOPIC_RECORDER}.log", MAX_REASON_CHARACTERS * 4)
            add_result_notes(folder, why.decode(errors="replace").splitlines()[:1])
        return {}
    _remove_unfinished(folder)
    parts = _parts(folder)
    losses: dict[str, str] = {}
    reports: list[RecorderReport] = []
    if not parts and (folder / BAG_FILE).is_file():
        return {}  # of ROS 1, whose recorder writes one file of its own
    if not parts:
        said = "; ".join(log_tail(folder, program)[1][-1:])
        notes = [f"ROS topics: their recorder recorded nothing{': ' * bool(said)}{said[:MAX_REASON_CHARACTERS]}"]
    else:
        reports = [report for part in parts if (report := _report(part)) is not None]
        notes = notes_of(reports, starts=len(parts))
        limit_s = _CANCELED_LIMIT_S if is_canceled else _LIMIT_S + _size(folder, parts) / _BYTES_A_SECOND
        lacks = _joined(folder, parts, (lambda: None) if is_canceled else stop, environment, limit_s)
        notes += [f"ROS topics{lack}" for lack in lacks]
        heard = [topic.name for report in reports for topic in report.topics]
        all_of_them = {name: f"its messages{lack}".removeprefix("its messages: ") for name in heard for lack in lacks}
        losses = {**all_of_them, **losses_of(reports, starts=len(parts))}
    if (result := read_result(folder)) is not None:
        about = result.extra.get("ros")
        add_result_notes(folder, [*notes, *unrecorded_commands(reports, about if isinstance(about, dict) else {})])
    else:
        for note in notes:
            add_note(folder, f"robomaker: {note}")
    return losses


def _remove_unfinished(folder: Path) -> None:
    """Deletes incomplete files that a recorder or a merging program was writing when it was killed."""
    for pattern in (f"ros-topics.*{_REPORT_SUFFIX}", *_JOINED):
        for left in folder.glob(unfinished_of(Path(pattern)).name):
            with suppress(OSError):
                left.unlink()


def _parts(folder: Path) -> list[Path]:
    found: list[int] = []
    with suppress(OSError):
        found = [int(match[1]) for entry in os.scandir(folder) if (match := _PART.fullmatch(entry.name))]
    return [part_path(folder, number) for number in sorted(found)]


def _report(part: Path) -> RecorderReport | None:
    try:
        return RecorderReport.model_validate_json(read_left(report_path(part), MAX_REPORT_BYTES))
    except (OSError, ValidationError):
        return None


def _size(folder: Path, parts: Sequence[Path]) -> int:
    size = 0
    for path in (folder / "recording.mcap", *parts):
        with suppress(OSError):
            size += path.lstat().st_blocks * _BLOCK_BYTES  # programs of the job may write there, holes too
    return size


def _joined(
    folder: Path, parts: Sequence[Path], stop: Callable[[], str | None], environment: Mapping[str, str], limit_s: float
) -> list[str]:
    """Merges the recordings of ROS topics with the run's recording, in a child process, and deletes their reports.

    Returns the failure as the end of a sentence about their topics, or an empty list; after a failure the files stay.

    Args:
        folder: Output folder of the run.
        parts: Recordings of ROS topics.
        stop: Returns why merging should stop, or `None`.
        environment: Environment variables of the child process.
        limit_s: Time limit in seconds.
    """
    names = [part.name for part in parts]
    command = [_JOINING, str(folder.absolute()), *names]
    said, problem = run_helper(command, stop=stop, environment=environment, limit_s=limit_s)
    # A child that is stopped while it deletes the parts has merged all of them before.
    if problem is not None and all(part.exists() for part in parts):
        _remove_unfinished(folder)
        return [f" are in {', '.join(names)}, and not in recording.mcap: {problem}"]
    for part in parts:
        part.unlink(missing_ok=True)
        with suppress(OSError):
            report_path(part).unlink()
    # Those of earlier starts were cut off in any case, which is noted.
    if names[-1] in said.get("cut", ()):
        return [": their recorder was killed before it had written its last messages"]
    return []
