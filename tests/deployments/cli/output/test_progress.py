"""Progress, on terminals and elsewhere."""

import io
import threading

import pytest
from helpers.processes import wait_for

from prefect_robomaker.deployments.cli.output.live_progress import LiveWatcher
from prefect_robomaker.deployments.cli.output.progress import PlainWatcher, watcher
from prefect_robomaker.deployments.cli.output.step_states import StepStates
from prefect_robomaker.schemas.reports.progress import Note, StepEnded, StepProgress, StepStarted
from prefect_robomaker.schemas.runs.trials import TrialCounts

STEPS = [("worlds", "CreateWorldGenerationJob"), ("drive", "StartSimulationJobBatch")]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.mark.parametrize(
    ("stream", "environ", "kind"),
    [
        (Terminal(), {}, LiveWatcher),
        (Terminal(), {"CI": "false"}, LiveWatcher),
        (Terminal(), {"CI": "true"}, PlainWatcher),
        (Terminal(), {"TERM": "dumb"}, PlainWatcher),
        (io.StringIO(), {}, PlainWatcher),
    ],
)
def test_only_terminals_are_animated(stream, environ, kind) -> None:
    assert isinstance(watcher(STEPS, environ, stream), kind)


def test_plain_progress_is_a_line_for_each_change() -> None:
    stream, clock = io.StringIO(), Clock()
    with PlainWatcher(STEPS, stream, clock=clock) as listener:
        listener(StepStarted("worlds", "CreateWorldGenerationJob"))
        for done in (0, 1, 1, 2):
            clock.now_s += 2
            listener(StepProgress("worlds", {"succeeded": done, "pending": 2 - done}, 2))
        listener(StepEnded("worlds", "Completed", 8.0, "arn:x"))
        listener(Note("remember this"))
    assert [line.split("] ")[1] for line in stream.getvalue().splitlines()] == [
        "worlds: started CreateWorldGenerationJob",
        "worlds: 2 pending of 2",
        "worlds: 1 succeeded, 1 pending of 2",
        "worlds: 2 succeeded of 2",
        "worlds: Completed after 8.0 s: arn:x",
        "remember this",
    ]


def test_what_the_next_job_waits_for_is_said_while_it_waits() -> None:
    stream, clock, terminal = io.StringIO(), Clock(), Terminal()
    waits = [StepProgress("drive", {"running": 1, "pending": 1}, 2, waits_for=scarce) for scarce in ("memory", None)]
    with PlainWatcher(STEPS, stream, clock=clock) as listener:
        for event in waits:
            clock.now_s += 2
            listener(event)
    with LiveWatcher(STEPS, terminal) as listener:
        listener(StepStarted("drive", "StartSimulationJobBatch"))
        listener(waits[0])

    assert [line.split("] ")[1] for line in stream.getvalue().splitlines()] == [
        "drive: 1 running, 1 pending of 2, waits for memory",
        "drive: 1 running, 1 pending of 2",
    ]
    assert "waits for memory" in terminal.getvalue()


def test_a_job_that_waits_for_a_machine_elsewhere_says_so() -> None:
    stream, clock = io.StringIO(), Clock()
    with PlainWatcher(STEPS, stream, clock=clock) as listener:
        clock.now_s += 2
        listener(StepProgress("drive", {"pending": 2}, 2, waits_for="worker"))

    assert stream.getvalue().endswith("drive: 2 pending of 2, waits for a job worker\n")


def test_trials_are_counted_beside_jobs_and_say_how_long_it_still_takes() -> None:
    stream, terminal, states = io.StringIO(), Terminal(), StepStates(STEPS)
    begun = StepStarted("drive", "StartSimulationJobBatch")
    event = StepProgress("drive", {"running": 2, "pending": 38}, 40, trials=TrialCounts(3100, 10_000))
    clock = Clock()
    with PlainWatcher(STEPS, stream, clock=clock) as listener:
        clock.now_s += 2
        listener(event)
    with LiveWatcher(STEPS, terminal) as listener:
        listener(begun)
        listener(event)
    for each in (begun, event):
        states.take(each, 0.0)

    assert stream.getvalue().endswith("drive: 2 running, 38 pending of 40, 3,100 of 10,000 trials\n")
    assert "━" * 6 in terminal.getvalue().partition("0/40")[0]
    assert states.steps["drive"].pace(31.0) == "100.0/s, 1 min 09 s to go"
    states.take(StepProgress("drive", {"running": 2}, 2, trials=TrialCounts(64, 64)), 1.0)
    assert states.steps["drive"].after_trials_text() == "outputs are stored"


def test_the_trials_of_a_single_job_are_all_that_is_counted() -> None:
    """They run one after the other, so that none of them is told to be running."""
    stream, terminal, clock = io.StringIO(), Terminal(), Clock()
    events = [
        StepStarted("drive", "CreateSimulationJob"),
        StepProgress("drive", {"running": 1}, 1, trials=TrialCounts(24, 50)),
    ]
    with PlainWatcher(STEPS, stream, clock=clock) as plain, LiveWatcher(STEPS, terminal) as live:
        for event in events:
            clock.now_s += 2
            plain(event)
            live(event)

    assert stream.getvalue().endswith("drive: 24 of 50 trials\n")
    assert "24 of 50 trials" in terminal.getvalue()
    assert "running" not in terminal.getvalue()


def test_trials_that_are_recorded_again_are_named_and_counted() -> None:
    stream, terminal, states = io.StringIO(), Terminal(), StepStates(STEPS)
    told = TrialCounts(64, 64, 2, 10, "records a video of trial 3 of job sim-1")
    events = [StepStarted("drive", "StartSimulationJobBatch"), StepProgress("drive", {"running": 2}, 2, trials=told)]
    clock = Clock()
    with PlainWatcher(STEPS, stream, clock=clock) as plain, LiveWatcher(STEPS, terminal) as live:
        for event in events:
            clock.now_s += 2
            plain(event)
            live(event)
            states.take(event, 0.0)

    words = "2 of 10 trials recorded, records a video of trial 3 of job sim-1"
    assert stream.getvalue().endswith(f"drive: 2 running of 2, 64 of 64 trials, {words}\n")
    assert words[:40] in terminal.getvalue()
    state = states.steps["drive"]
    assert state.work == (66, 74)
    assert state.pace(31.0) == "", "a recording takes longer than a trial"
    states.take(StepProgress("drive", {"completed": 2}, 2, trials=TrialCounts(64, 64, 10, 10)), 1.0)
    assert state.after_trials_text() == "", "nothing is left to do"


def test_a_flood_of_changes_is_thinned_but_the_last_is_told() -> None:
    stream, clock = io.StringIO(), Clock()
    with PlainWatcher(STEPS, stream, clock=clock) as listener:
        for done in range(1001):
            clock.now_s += 0.01
            listener(StepProgress("drive", {"completed": done, "running": 1000 - done}, 1000))
    lines = stream.getvalue().splitlines()
    assert len(lines) <= 12
    assert lines[-1].endswith("drive: 1000 completed of 1000")


def test_silence_is_broken_by_a_heartbeat() -> None:
    stream = io.StringIO()
    with PlainWatcher(STEPS, stream, heartbeat_s=0.05) as listener:
        listener(StepStarted("drive", "StartSimulationJobBatch"))
        wait_for(lambda: "drive: running" in stream.getvalue(), "the heartbeat")


def test_live_progress_shows_every_step_and_ends_as_it_was() -> None:
    terminal = Terminal()
    with LiveWatcher(STEPS, terminal) as listener:
        listener(StepStarted("worlds", "CreateWorldGenerationJob"))
        listener(StepEnded("worlds", "Completed", 1.5, "arn:aws:robomaker:r:0:world-generation-job/generation-1"))
        listener(StepStarted("drive", "StartSimulationJobBatch"))
        listener(StepProgress("drive", {"completed": 1, "failed": 1, "running": 2}, 4, "sim-1: it crashed"))
    shown = terminal.getvalue()
    for expected in ("worlds", "1.5 s", "world-generation-job/generation-1", "2/4", "1 failed", "sim-1: it crashed"):
        assert expected in shown


def test_a_long_note_is_shown_to_its_end_also_in_a_narrow_window() -> None:
    terminal, words = Terminal(), [f"word{number}" for number in range(60)]
    with LiveWatcher(STEPS, terminal) as listener:
        listener(Note(" ".join(words)))
    assert all(word in terminal.getvalue() for word in words)


def test_events_may_come_from_many_threads() -> None:
    stream = io.StringIO()
    with PlainWatcher(STEPS, stream) as listener:
        threads = [
            threading.Thread(target=lambda number=number: [listener(Note(f"{number}-{n}")) for n in range(50)])
            for number in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 400
    assert all(line.startswith("[") for line in lines)


def test_a_world_that_is_taken_over_is_no_new_one() -> None:
    terminal = Terminal()
    with LiveWatcher(STEPS, terminal) as live:
        live(StepStarted("worlds", "CreateWorldGenerationJob"))
        live(StepProgress("worlds", {"taken over": 1, "succeeded": 0}, 1))
        live(StepEnded("worlds", "Completed", 0.2, "arn:aws:robomaker:eu:1:world-generation-job/generation-1"))
    assert "1 taken over  world-generation-job/generation-1" in terminal.getvalue()


def test_pace_is_told_from_what_is_done() -> None:
    states = StepStates(STEPS)
    states.take(StepStarted("drive", "StartSimulationJobBatch"), 0.0)
    drive = states.steps["drive"]
    assert drive.pace(10.0) == ""
    states.take(StepProgress("drive", {"Completed": 4, "not created": 1, "Running": 1}, 10), 10.0)
    assert drive.done == 5
    assert drive.pace(10.0) == "30.0/min, 10 s to go"
    states.take(StepProgress("drive", {"completed": 10}, 10), 20.0)
    assert drive.pace(20.0) == ""


@pytest.mark.parametrize(
    ("ended", "mark", "plain"),
    [
        (StepEnded("drive", "Completed", 8.0, "arn:x", {"passed": 2}), "✓", "2 passed after 8.0 s: arn:x"),
        (StepEnded("drive", "Completed", 8.0, "", {"failed": 1, "passed": 1}), "✗", "1 passed, 1 failed after 8.0 s"),
        (StepEnded("drive", "Completed", 8.0, "", {"broken": 1}, may_be_known=True), "✗", "1 broken after 8.0 s"),
        (StepEnded("drive", "Completed", 8.0, "", {"failed": 2}, may_be_known=True), "!", "2 failed after 8.0 s"),
        (StepEnded("drive", "Canceled", 8.0, "", {"canceled": 2}), "✗", "Canceled, 2 canceled after 8.0 s"),
        (StepEnded("drive", "Completed", 8.0, "arn:x"), "✓", "Completed after 8.0 s: arn:x"),
    ],
)
def test_a_step_looks_as_its_jobs_ended_and_says_it_in_their_words(ended: StepEnded, mark: str, plain: str) -> None:
    stream, terminal = io.StringIO(), Terminal()
    with PlainWatcher(STEPS, stream) as listener:
        listener(ended)
    with LiveWatcher(STEPS, terminal) as listener:
        listener(StepProgress("drive", {"completed": 2}, 2))
        listener(ended)

    assert stream.getvalue().rstrip().endswith(f"drive: {plain}")
    last = next(line for line in reversed(terminal.getvalue().splitlines()) if "drive" in line)
    assert mark in last
    assert "completed" not in last or not ended.outcomes


def test_a_line_a_minute_says_what_is_done_while_no_step_runs() -> None:
    stream = io.StringIO()
    ends = [StepEnded(name, "Completed", 1.0) for name, _ in STEPS]
    with PlainWatcher(STEPS, stream, heartbeat_s=0.01) as listener:
        for event, told in zip(
            (None, *ends),
            ("the run begins at the Prefect server", "between worlds and the next step", "the report is written"),
            strict=True,
        ):
            if event is not None:
                listener(event)
            wait_for(lambda told=told: f"still at work: {told}\n" in stream.getvalue(), told)
