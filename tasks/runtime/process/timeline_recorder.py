"""Observer that writes a run's timeline: margins of its requirements, lengths of its logs, times of its video."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from ..episode.run_results import Findings, Observer
from ..episode.run_timeline import MOST_SAMPLES, FilmTimes, LogSeries, MarginSeries, RunTimeline, write_timeline
from ..limits.logs import LOG_FOLDER
from ..requirements.observer import RequirementsObserver

_PERIOD_S = 0.1
"""Simulated seconds between two looks: requirements look as often, and a log's line is told to such a time."""
_MOST_LOGS = 8
"""Number of logs that are followed, as many as pages show."""
_MOST_SERIES = 50
"""Number of margins that are followed."""
_FIND_LOGS_EVERY = 20
"""Looks between two searches for new logs, which cost more than all the rest."""
_ROUNDING_DIGITS = 6

Value = TypeVar("Value", int, float)


class BoundedSeries(Generic[Value]):
    """Series of changing values by time that stays short: the longer it gets, the longer are its steps.

    The first sample, the last one and those that are to be kept stay, whatever else goes.
    """

    def __init__(self, most: int = MOST_SAMPLES) -> None:
        self._most, self._every_s = most, 0.0
        self._samples: list[tuple[float, Value, bool]] = []
        self._last: tuple[float, Value] | None = None

    def add(self, time_s: float, value: Value, *, keep: bool = False) -> None:
        """Adds a sample, unless its value is that of the last one, or the last one is too near.

        Args:
            time_s: Simulated time, later than that of all others.
            value: Value from then on.
            keep: Whether the sample stays in any case.
        """
        is_same = self._last is not None and self._last[1] == value
        self._last = time_s, value
        if not keep and self._samples and (is_same or time_s - self._samples[-1][0] < self._every_s):
            return
        self._samples.append((time_s, value, keep))
        if len(self._samples) >= self._most - 1:  # the last sample comes on top
            self._thin_out()

    def samples(self) -> list[tuple[float, Value]]:
        """Returns the series as times in seconds and values, with its last sample if the value has changed."""
        found = [(round(time_s, _ROUNDING_DIGITS), value) for time_s, value, _ in self._samples]
        if self._last is not None and found and self._last[1] != found[-1][1]:
            found.append((round(self._last[0], _ROUNDING_DIGITS), self._last[1]))
        return found

    def _thin_out(self) -> None:
        first, last = self._samples[0], self._samples[-1]
        span_s = last[0] - first[0]
        self._every_s = max(2 * self._every_s, 2 * span_s / self._most)
        inner = self._samples[1:-1]
        self._samples = [first, *(each for index, each in enumerate(inner) if each[2] or index % 2), last]


class TimelineRecorder(Observer):
    """Observer that writes `timeline.json` at the end of a run, also of one that failed.

    It comes after the observers that it asks, so that it knows what they have found at the same time.
    """

    def __init__(
        self,
        output_dir: Path,
        requirements: RequirementsObserver,
        film: Callable[[], dict[str, FilmTimes]] = dict,
    ) -> None:
        """Prepares to note a run's timeline, which `close` writes.

        Args:
            output_dir: Folder of the run's outputs.
            requirements: Observer that judges the run.
            film: Returns the times of the video that was recorded with the run, once that is closed.
        """
        self._output_dir, self._requirements, self._film = output_dir, requirements, film
        self._margins: dict[tuple[str, str | None], BoundedSeries[float]] = {}
        self._violated: set[str] = set()
        self._mute: set[str] = set()
        """Names of requirements that have no margin before the end."""
        self._logs: dict[str, BoundedSeries[int]] = {}
        self._looks = 0
        self._time_s = 0.0

    def watch(self, environment: Any, time_s: float) -> None:
        """Notes the present margins of the requirements and the lengths of the logs, for the timeline."""
        del environment
        self.next_time_s = time_s + _PERIOD_S
        self._look(time_s)

    def hear(self, state: bytes, time_s: float) -> None:
        """Notes the lengths of the logs of a run in an environment without physics."""
        del state
        if time_s >= self.next_time_s - 5e-7:  # half a microsecond forgives rounding in sums of time steps
            self.watch(None, time_s)

    def state(self) -> Any:
        """Returns all series for a checkpoint."""
        return self.next_time_s, self._margins, self._violated, self._mute, self._logs, self._time_s

    def restore(self, state: Any, environment: Any) -> None:
        """Continues the series of a checkpoint."""
        del environment
        self.next_time_s, self._margins, self._violated, self._mute, self._logs, self._time_s = state

    def close(self, ended_by: str | None) -> Findings:
        """Writes `timeline.json` into the output folder; returns no findings.

        Args:
            ended_by: Reason why the run ended; `None`: it was cut short, and its last margins are not judged.
        """
        self._note_lengths(self._time_s)
        if ended_by is not None:
            self._note_judged()
        margins = [
            MarginSeries(requirement=name, unit=unit, samples=samples)
            for (name, unit), series in self._margins.items()
            if (samples := series.samples())
        ]
        logs = [LogSeries(name=f"{LOG_FOLDER}/{name}", samples=each.samples()) for name, each in self._logs.items()]
        write_timeline(RunTimeline(margins=margins, logs=logs, videos=self._film()), self._output_dir)
        return Findings()

    def _look(self, time_s: float) -> None:
        self._time_s = time_s
        self._note_lengths(time_s)
        for rule in self._requirements.rules[:_MOST_SERIES]:
            name = rule.asked.name
            if name in self._mute:
                continue
            try:
                margin = rule.margin_until(time_s)
            except Exception:  # of kinds from elsewhere that know no number before the end: a drawing fails no run
                self._mute.add(name)
                continue
            is_new = rule.violated_s is not None and name not in self._violated
            if is_new:
                self._violated.add(name)
            self._note_margin(name, margin, time_s, keep=is_new)

    def _note_judged(self) -> None:
        """Adds the margins of the result, since some kinds know theirs at the end only."""
        end_s = max(self._time_s, self._requirements.time_s)
        for judged in self._requirements.judged[:_MOST_SERIES]:
            if judged.margin is not None and judged.error is None:
                self._note_margin(judged.name, (judged.margin, judged.unit), end_s)

    def _note_margin(
        self, name: str, margin: tuple[float, str | None] | None, time_s: float, *, keep: bool = False
    ) -> None:
        if margin is None or not math.isfinite(margin[0]):
            return
        series = self._margins.setdefault((name, margin[1]), BoundedSeries[float]())
        series.add(time_s, round(margin[0], _ROUNDING_DIGITS), keep=keep)

    def _note_lengths(self, time_s: float) -> None:
        folder = self._output_dir / LOG_FOLDER
        if self._looks % _FIND_LOGS_EVERY == 0:
            self._find_logs(folder)
        self._looks += 1
        for name, series in self._logs.items():
            try:
                # A program may have put a link there, whose length says nothing.
                size = os.stat(folder / name, follow_symlinks=False).st_size  # noqa: PTH116 - a third faster
            except OSError:
                continue
            series.add(time_s, size)

    def _find_logs(self, folder: Path) -> None:
        try:
            with os.scandir(folder) as entries:
                names = sorted(each.name for each in entries if each.name.endswith(".log"))
        except OSError:  # the application may have removed them
            return
        for name in names:
            if name not in self._logs and len(self._logs) < _MOST_LOGS:
                self._logs[name] = BoundedSeries[int]()
