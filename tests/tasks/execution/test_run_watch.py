"""Watching flow runs: a cancellation is passed on until it is taken, and a server that fails holds nothing up."""

import http.server
import os
import subprocess
import sys
import threading
import uuid
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
from helpers.processes import wait_for
from prefect.settings import PREFECT_API_URL, temporary_settings

from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.execution import run_watch
from prefect_robomaker.tasks.execution.prefect_settings import asking_once
from prefect_robomaker.tasks.execution.run_watch import RunWatch, _Watched


@pytest.fixture
def cancelled_run(prefect_server: str) -> Any:
    """Id of a flow run that is cancelled in Prefect."""
    from prefect import flow
    from prefect.client.orchestration import get_client
    from prefect.states import Cancelling

    @flow(name="watched")
    def watched() -> None:
        """Does nothing."""

    with get_client(sync_client=True) as client:
        run = client.create_flow_run(watched)
        client.set_flow_run_state(run.id, Cancelling(), force=True)
    return run.id


def test_a_cancellation_that_the_catalog_does_not_take_is_passed_on_again_and_then_once(cancelled_run: Any) -> None:
    calls: list[str] = []

    def cancel() -> None:
        calls.append("cancel")
        if len(calls) == 1:
            raise ServiceUnavailableException("the catalog does not answer")

    with RunWatch().watching(cancelled_run, "watched", cancel):
        wait_for(lambda: len(calls) == 2, "the second try")
    runs = {cancelled_run: _Watched("watched", cancel, lambda: True)}
    with asking_once() as client:
        RunWatch._pass_on_cancellations(runs, client)
        RunWatch._pass_on_cancellations(runs, client)

    assert len(calls) == 3


def test_a_busy_server_is_asked_once_at_a_time_since_signs_of_life_wait_meanwhile() -> None:
    asked: list[str] = []

    class Busy(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(503)
            self.send_header("Content-Length", "0")
            self.end_headers()

        do_POST = do_GET  # noqa: N815 - its name there

        def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002 - its name there
            """Says nothing."""

    with http.server.HTTPServer(("127.0.0.1", 0), Busy) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        chosen: dict[Any, Any] = {PREFECT_API_URL: f"http://127.0.0.1:{server.server_address[1]}/api"}
        runs = {uuid.uuid4(): _Watched("watched", lambda: None, lambda: True)}
        with temporary_settings(chosen), asking_once() as client, pytest.raises(httpx.HTTPStatusError):
            RunWatch._pass_on_cancellations(runs, client)
        server.shutdown()
        thread.join()

    assert len(asked) == 1


def test_the_watch_makes_one_client_while_the_server_answers_and_another_after_it_did_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To make one costs 40 ms of CPU, every two seconds, for as long as a batch runs."""
    made: list[int] = []
    looks: list[int] = []

    @contextmanager
    def counted() -> Generator[None]:
        made.append(len(looks))
        yield

    def look(watch: RunWatch, runs: object, client: object) -> None:
        looks.append(len(looks))
        if len(looks) == 3:
            raise httpx.ConnectError("the server is away")

    monkeypatch.setattr(run_watch, "asking_once", counted)
    monkeypatch.setattr(run_watch, "_LOOK_S", 0.01)
    monkeypatch.setattr(RunWatch, "_look", look)
    with RunWatch().watching(uuid.uuid4(), "watched", lambda: None):
        wait_for(lambda: len(looks) > 5, "some looks")

    assert made == [0, 3]


def test_a_run_that_was_closed_as_dead_is_taken_back_by_the_process_that_goes_on(prefect_server: str) -> None:
    from prefect import flow, task
    from prefect.client.orchestration import get_client
    from prefect.states import Crashed, Running

    from prefect_robomaker.tasks.execution.dead_flow_runs import _NO_SIGN, _PART_OF_DEAD, _TASK_OF_DEAD

    @flow(name="sleeper")
    def sleeper() -> None:
        """Does nothing."""

    @task(name="step")
    def step() -> None:
        """Does nothing."""

    with get_client(sync_client=True) as client:

        def crashed(words: str) -> uuid.UUID:
            run = client.create_flow_run(sleeper, state=Running())
            client.set_flow_run_state(run.id, Crashed(message=words), force=True)
            return run.id

        outer, part, lost = crashed(_NO_SIGN), crashed(_PART_OF_DEAD), crashed(_NO_SIGN)
        other = crashed("its process ended")  # which somebody saw
        inner = client.create_task_run(step, part, dynamic_key="0", state=Crashed(message=_TASK_OF_DEAD)).id
        runs = {
            outer: _Watched("outer", lambda: None, lambda: True, {part, other}),
            lost: _Watched("lost", lambda: None, lambda: False),
        }
        watch = RunWatch(runs)
        for _ in range(2):
            watch._take_back(runs, client)

        states = [client.read_flow_run(run).state for run in (outer, part, lost, other)]
        assert [state.name if state else None for state in states] == ["Running", "Running", "Crashed", "Crashed"]
        wait_for(
            lambda: (state := client.read_task_run(inner).state) is not None and state.is_running(),
            "the task run that is taken back",
        )


def test_a_run_that_comes_to_its_end_while_it_is_to_be_taken_back_stays_ended(prefect_server: str) -> None:
    """A laptop that wakes: one thread says how the run ended, the other still sees that it was closed as dead."""
    from prefect import flow
    from prefect.client.orchestration import get_client
    from prefect.states import Completed, Crashed, Running

    from prefect_robomaker.tasks.execution.dead_flow_runs import _NO_SIGN, _PART_OF_DEAD

    @flow(name="sleeper")
    def sleeper() -> None:
        """Does nothing."""

    with get_client(sync_client=True) as client:

        def crashed(words: str) -> uuid.UUID:
            run = client.create_flow_run(sleeper, state=Running())
            client.set_flow_run_state(run.id, Crashed(message=words), force=True)
            return run.id

        def end(run: uuid.UUID) -> bool:
            client.set_flow_run_state(run, Completed())
            return True

        outer, open_outer, part = crashed(_NO_SIGN), crashed(_NO_SIGN), crashed(_PART_OF_DEAD)
        watch = RunWatch()

        def outer_ends() -> bool:
            del watch._runs[outer]
            return end(outer)

        def part_ends() -> bool:
            watch._runs[open_outer].parts.discard(part)
            return end(part)

        watch._runs |= {
            outer: _Watched("outer", lambda: None, outer_ends),
            open_outer: _Watched("open", lambda: None, part_ends, {part}),
        }
        watch._take_back(dict(watch._runs), client)

        states = [client.read_flow_run(run).state for run in (outer, open_outer, part)]
    assert [state.name if state else None for state in states] == ["Completed", "Running", "Completed"]


def test_a_run_that_is_being_taken_back_is_told_to_have_ended_only_after_that(monkeypatch: pytest.MonkeyPatch) -> None:
    happened: list[str] = []
    inside, leave = threading.Event(), threading.Event()
    run = uuid.uuid4()

    def taken_back(*_: object) -> None:
        leave.set()
        assert not ended.wait(0.3)
        happened.append("taken back")

    monkeypatch.setattr(RunWatch, "_watch", lambda _: None)
    monkeypatch.setattr(run_watch, "closed_as_dead", lambda *_: [run])
    monkeypatch.setattr(run_watch, "take_back", taken_back)
    watch, ended = RunWatch(), threading.Event()

    def live() -> None:
        with watch.watching(run, "run", lambda: None):
            inside.set()
            leave.wait(200)
        happened.append("ended")
        ended.set()

    living = threading.Thread(target=live)
    living.start()
    inside.wait(200)
    watch._take_back(dict(watch._runs), None)  # type: ignore[arg-type]  # what asks the server is replaced
    living.join()

    assert happened == ["taken back", "ended"]


ENDS = """
import time, uuid
from typing import Annotated
from pydantic import BeforeValidator, TypeAdapter
from prefect_robomaker.tasks.execution.run_watch import RunWatch

def validate(self, runs, client):
    end, adapter = time.monotonic() + 0.5, TypeAdapter(list[Annotated[int, BeforeValidator(lambda value: int(value))]])
    while time.monotonic() < end:
        adapter.validate_python(["1"] * 1000)

RunWatch._pass_on_cancellations = validate
RunWatch._beat = lambda self, runs: False
with RunWatch().watching(uuid.uuid4(), "ends", lambda: None):
    time.sleep(0.1)
"""


@pytest.mark.deep
def test_a_process_that_ends_while_it_looks_at_its_runs_ends_well() -> None:
    """A daemon thread in pydantic's Rust code aborts Python's end: `FATAL: exception not rethrown`."""
    environ = {**os.environ, "PREFECT_API_URL": "http://127.0.0.1:9/api"}  # else a server is started
    words = [sys.executable, "-c", ENDS]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, timeout=240, env=environ)
    assert (ended.returncode, ended.stderr) == (0, "")
