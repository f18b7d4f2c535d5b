"""Progress display of a run: an animated block on a terminal, one line per change elsewhere."""

import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Self, TextIO

from ....schemas.reports.progress import Note, ProgressEvent, StepEnded, StepStarted
from .answers import duration
from .step_states import StepState, StepStates, Watcher

_HEARTBEAT_S = 60.0
# Counts of a large batch change many times a second.
_LINE_EVERY_S = 1.0

Clock = Callable[[], float]


def watcher(steps: Sequence[tuple[str, str]], environ: Mapping[str, str], stream: TextIO | None = None) -> Watcher:
    """Chooses the progress display for the output: animated on a terminal, else plain lines.

    Args:
        steps: Names and operations, in the order they run.
        environ: Environment variables; `CI` and a dumb `TERM` mean no animation.
        stream: Output stream; absent: standard error.
    """
    out: TextIO = sys.stderr if stream is None else stream
    if not is_animated(out, environ):
        return PlainWatcher(steps, out)
    from .live_progress import LiveWatcher

    return LiveWatcher(steps, out)


def is_animated(stream: TextIO, environ: Mapping[str, str]) -> bool:
    """Whether progress may be redrawn: on a terminal, unless `CI` or a dumb `TERM` forbid it."""
    return stream.isatty() and not _truthy(environ.get("CI")) and environ.get("TERM") != "dumb"


def _truthy(value: str | None) -> bool:
    return (value or "").lower() not in ("", "0", "false", "no")


class PlainWatcher(Watcher):
    """Progress display of a run in plain lines: one for each change, and one a minute without changes.

    Args:
        steps: Names and operations, in the order they run.
        stream: Output stream, such as standard output.
        clock: Seconds on a clock that only runs forward.
        heartbeat_s: Longest silence.
    """

    def __init__(
        self,
        steps: Sequence[tuple[str, str]],
        stream: TextIO,
        *,
        clock: Clock = time.monotonic,
        heartbeat_s: float = _HEARTBEAT_S,
    ) -> None:
        self._states = StepStates(steps)
        self._stream = stream
        self._clock = clock
        self._began = self._printed = clock()
        self._heartbeat_s = heartbeat_s
        self._newest = ""
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._pulse = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self) -> Self:
        self._pulse.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._pulse.join()

    def __call__(self, event: ProgressEvent) -> None:
        """Prints the changes that an event of the run causes; from any thread."""
        with self._lock:
            self._states.take(event, self._clock())
            line = self._line(event)
            if line and line != self._newest:
                self._print(line)

    def _line(self, event: ProgressEvent) -> str:
        if isinstance(event, Note):
            return event.text
        state = self._states.steps[event.step]
        if isinstance(event, StepStarted):
            return f"{event.step}: started {event.operation}"
        if isinstance(event, StepEnded):
            detail = f": {event.detail}" if event.detail else ""
            return f"{event.step}: {event.in_words} after {duration(event.duration_s)}{detail}"
        soon = self._clock() - self._printed < _LINE_EVERY_S
        return "" if soon and state.done < state.total else _progress_line(state)

    def _print(self, line: str) -> None:
        self._printed, self._newest = self._clock(), line
        self._stream.write(f"[{duration(self._printed - self._began):>12}] {line}\n")
        self._stream.flush()

    def _beat(self) -> None:
        while not self._ended.wait(min(self._heartbeat_s, 1.0)):
            with self._lock:
                if self._clock() - self._printed >= self._heartbeat_s:
                    running = [state for state in self._states.steps.values() if state.is_running]
                    self._print("; ".join(map(_progress_line, running)) or f"still at work: {self._at_what()}")

    def _at_what(self) -> str:
        """Says what is done while no step runs."""
        ended = [state.name for state in self._states.steps.values() if state.ended is not None]
        if not ended:
            return "the run begins at the Prefect server"
        left = len(self._states.steps) - len(ended)
        return f"between {ended[-1]} and the next step" if left else "the report is written"


def _progress_line(state: StepState) -> str:
    counts = state.parts_text()
    if not counts and not state.trials_text():
        return f"{state.name}: running"
    told = (
        f"{counts} of {state.total}" if counts else "",
        state.trials_text(),
        state.after_trials_text(),
        state.wait_text(),
    )
    return f"{state.name}: {', '.join(filter(None, told))}"
