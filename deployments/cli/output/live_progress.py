"""Animated progress display on a terminal: a block that is redrawn while the run goes on."""

import threading
import time
from collections.abc import Mapping, Sequence
from typing import Self, TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from ....schemas.reports.progress import ProgressEvent, StepEnded
from .answers import duration
from .step_states import Look, StepState, StepStates, Watcher, look_of

_BAR_WIDTH = 20
_SHOWN_NOTES = 3
_MARKS: Mapping[Look, tuple[str, str]] = {"good": ("✓", "green"), "bad": ("✗", "red"), "unsure": ("!", "yellow")}


class LiveWatcher(Watcher):
    """Progress display of a run that redraws its steps, bars and failures on a terminal.

    Args:
        steps: Names and operations, in the order they run.
        stream: A terminal.
    """

    def __init__(self, steps: Sequence[tuple[str, str]], stream: TextIO) -> None:
        self._states = StepStates(steps)
        self._lock = threading.Lock()
        self._spinner = Spinner("dots", style="cyan")
        console = Console(file=stream, highlight=False)
        self._live = Live(console=console, get_renderable=self.render, refresh_per_second=8)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def __call__(self, event: ProgressEvent) -> None:
        """Updates the progress display by an event of the run; from any thread."""
        with self._lock:
            self._states.take(event, time.monotonic())

    def render(self) -> Group:
        """Draws the current progress of the run."""
        table = Table.grid(padding=(0, 2, 0, 0), expand=True)
        for justify in ("left", "left", "right"):
            table.add_column(no_wrap=True, justify=justify)
        # Only what is said last gives way in a narrow window.
        table.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        with self._lock:
            now = time.monotonic()
            for state in self._states.steps.values():
                table.add_row(*self._row(state, now))
                if state.is_running and state.after_trials_text():  # a line of its own: windows may be narrow
                    table.add_row("", "", "", Text(state.after_trials_text(), style="dim"))
                if state.is_running and state.wait_text():
                    table.add_row("", "", "", Text(state.wait_text(), style="yellow"))
                if state.is_running and state.newest_failure:
                    table.add_row("", "", "", Text(state.newest_failure, style="red"))
            notes = [Text(note, style="dim") for note in self._states.notes[-_SHOWN_NOTES:]]
        return Group(table, *notes)

    def _row(self, state: StepState, now: float) -> tuple[Text | Spinner, Text, Text, Text]:
        if (ended := state.ended) is not None:
            look = look_of(ended)
            sign, style = _MARKS[look]
            took = Text(duration(ended.duration_s) if ended.status != "Skipped" else "")
            colour = style if look != "good" else ""
            said = Text.assemble((ended.in_words, colour), "  ", (_ending(state, ended), "" if colour else "dim"))
            return Text(sign, style=style), Text(state.name), took, said
        if state.started_s is None:
            return Text("·", style="dim"), Text(state.name, style="dim"), Text(""), Text(state.operation, style="dim")
        elapsed = Text(duration(now - state.started_s), style="cyan")
        return self._spinner, Text(state.name, style="bold"), elapsed, _activity(state, now)


def _ending(state: StepState, ended: StepEnded) -> str:
    """Returns the numbers of a step's worlds, as those of its jobs are said already, and its ARN or error."""
    is_told = (state.total > 1 or state.counts.get("taken over")) and not ended.outcomes
    counts = state.counts_text() if is_told else ""
    detail = ended.detail.splitlines()[0] if ended.detail else ""
    if detail.startswith("arn:"):
        detail = detail.split(":", 5)[-1]
    return "  ".join(filter(None, (counts, detail)))


def _activity(state: StepState, now: float) -> Text:
    if not state.total:
        return Text(state.operation)
    done, total = state.work
    filled = _BAR_WIDTH * done // total
    bar = (("━" * filled, "cyan"), ("━" * (_BAR_WIDTH - filled), "dim"))
    counts = state.parts_text()
    parts = [f"{state.done}/{state.total}" if counts else "", counts, state.trials_text(), state.pace(now)]
    return Text.assemble(*bar, "  ", "  ".join(part for part in parts if part))
