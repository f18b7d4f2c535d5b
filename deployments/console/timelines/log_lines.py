"""Lines of a log's end, each with the simulated time at which it was there."""

from bisect import bisect_left
from dataclasses import dataclass
from itertools import accumulate

from ....schemas.wire.common import without_escapes
from ....tasks.runtime.episode.run_timeline import LogSeries


@dataclass(frozen=True)
class LogLine:
    """A line of a log for a page."""

    text: str
    time_s: float | None
    """Simulated time by which it was written, to a tenth of a second; None: not known."""


def lines_of(data: bytes, size_bytes: int, series: LogSeries | None) -> list[LogLine]:
    """Splits the end of a log into lines, without colour codes.

    A line that was written after the last look has no time: programs go on a moment after the simulation has ended.

    Args:
        data: The last bytes of the log.
        size_bytes: Length of the whole log.
        series: Lengths of the log along the run; None: they were not recorded.
    """
    # A log that a program has emptied meanwhile is as long as it ever was: its lines have to be in order.
    lengths = [] if series is None else [*accumulate((length for _, length in series.samples), max)]
    end = size_bytes - len(data)
    found: list[LogLine] = []
    for raw in data.splitlines(keepends=True):
        end += len(raw)
        text = without_escapes(raw.decode(errors="replace").rstrip("\r\n"))
        # Half of a line may have been there before: it counts once all of it was.
        index = bisect_left(lengths, end - (len(raw) - len(raw.rstrip(b"\r\n"))))
        is_known = series is not None and index < len(lengths)
        found.append(LogLine(text, series.samples[index][0] if is_known and series is not None else None))
    return found
