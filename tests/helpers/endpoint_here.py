"""`robomaker serve --execute none` in a thread of this process: what it answers, in a tenth of a process' time.

Signals, job workers, and what a process leaves behind are seen with `helpers.endpoint_process`.
"""

import io
import json
import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from starlette.types import ASGIApp

from helpers.endpoint_process import Endpoint
from helpers.processes import wait_for
from prefect_robomaker.deployments.cli import server_and_worker as serving_module
from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.deployments.endpoint import server as server_module
from prefect_robomaker.tasks.service.service import Service

_LOGGERS = ("prefect_robomaker", "robomaker.access", "robomaker.endpoint")
_WORDS = ("serve", "--port", "0", "-o", "json", "--execute", "none")

ServeHere = Callable[..., AbstractContextManager[Endpoint]]


@contextmanager
def serving_here(home: Path, folder: Path, *words: str, **variables: str) -> Iterator[Endpoint]:
    """Serves a data home; its log goes to a folder.

    Args:
        home: The data home.
        folder: Where the log goes.
        *words: Further words of the command line.
        **variables: Environment variables, also of this process meanwhile.
    """
    path = folder / f"serve-{len(list(folder.glob('serve-*')))}.log"
    said = io.StringIO()
    with ExitStack() as stack:
        stack.enter_context(mock.patch.dict(os.environ, {"ROBOMAKER_HOME": str(home), **variables}))
        stack.enter_context(_loggers_put_back())
        log = stack.enter_context(path.open("w", buffering=1))
        # Only a process' main thread may say what signals do.
        stack.enter_context(mock.patch.object(serving_module, "_end_on_hang_up"))
        arguments = build_parser().parse_args([*_WORDS, *words])
        with redirect_stdout(said), redirect_stderr(log):
            stack.enter_context(_in_a_thread(lambda: serving_module.serve(arguments), said.getvalue))
        yield Endpoint(json.loads(said.getvalue()), path)


@contextmanager
def endpoint_here(application: ASGIApp, **options: Any) -> Iterator[int]:
    """The port where an application is served by `run_server`, with options of that, in a thread of this process."""
    ports: list[int] = []

    def serve() -> None:
        server_module.run_server(application, "127.0.0.1", 0, ready=ports.append, **options)

    with _in_a_thread(serve, lambda: ports):
        yield ports[0]


@contextmanager
def _in_a_thread(serve: Callable[[], object], is_ready: Callable[[], object]) -> Iterator[None]:
    """Serves in a thread until the block ends, as if it was told to stop."""
    servers: list[Any] = []
    failures: list[BaseException] = []

    class Stoppable(server_module._Server):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            servers.append(self)

    def run() -> None:
        try:
            serve()
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run, name="served here")
    with mock.patch.object(server_module, "_Server", Stoppable):
        thread.start()
        wait_for(lambda: is_ready() or failures, "the endpoint")
    try:
        if not failures:
            yield
    finally:
        for server in servers:
            server.should_exit = True
        thread.join(200)
    if failures:
        raise failures[0]
    assert not thread.is_alive(), "the endpoint did not stop"


@contextmanager
def _loggers_put_back() -> Iterator[None]:
    """Has loggers afterwards as they were before, for tests that read logs."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    before: Sequence[tuple[logging.Logger, list[logging.Handler], int, bool]] = [
        (each, list(each.handlers), each.level, each.propagate) for each in loggers
    ]
    try:
        yield
    finally:
        for logger, handlers, level, propagate in before:
            logger.handlers, logger.propagate = handlers, propagate
            logger.setLevel(level)


@pytest.fixture
def serve_here(service: Service, tmp_path: Path) -> ServeHere:
    """Serves the test's service in this process; keyword arguments are environment variables."""
    return partial(serving_here, service.settings.home, tmp_path)
