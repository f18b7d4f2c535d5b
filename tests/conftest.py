"""Fixtures for all tests."""

import gc
import os
import re
import signal
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from _pytest.assertion import rewrite
from hypothesis.internal.conjecture import providers

from prefect_robomaker.schemas.settings import Settings

pytest_plugins = [
    "helpers.command_here",
    "helpers.endpoint_here",
    "helpers.endpoint_process",
    "helpers.job_worker_process",
    "helpers.known_worlds",
    "helpers.minio_server",
    "helpers.mortal_prefect",
    "helpers.postgres_server",
    "helpers.prefect_server",
    "helpers.real_engine",
    "helpers.receivers",
    "helpers.repeating",
    "helpers.ros1_nodes",
    "helpers.s3_server",
    "helpers.service_fixtures",
    "helpers.swing_fixtures",
]
pytest.register_assert_rewrite("helpers")
# Images of containers often set this. Every process that a test starts would then compile all of our modules anew, for
# which a call of the command line takes a quarter longer, and every worker of pytest all tests, which takes 10 s.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# A busy machine does not make a change wrong, nor do examples of chance: whole runs take the same ones each time, and
# no example is too slow. `--hypothesis-profile=search` takes others, as `.ci/quick` does: what it finds becomes an
# example of its test. `--hypothesis-profile=deep` takes more of them (see `helpers.examples`).
_slow_machine = [hypothesis.HealthCheck.too_slow]
for _name, _options in {
    "robomaker": {"max_examples": 20, "derandomize": True},
    "deep": {"max_examples": 100, "derandomize": True},
    "search": {"max_examples": 100, "derandomize": False},
}.items():
    hypothesis.settings.register_profile(_name, deadline=None, suppress_health_check=_slow_machine, **_options)
hypothesis.settings.load_profile("robomaker")
if "--hypothesis-profile=search" not in sys.argv:
    # Hypothesis also tries constants of all local modules that were imported so far. The examples of a test would then
    # depend on which other tests its worker ran before: a fault was found on one machine and on no other.
    setattr(providers, "is_local_module_file", lambda _path: False)  # noqa: B010 - not exported, so for no type checker
_DEEPER = ("deep", "(deep or hypothesis)")
"""How expressions of markers begin that choose deep tests or those of hypothesis alone."""


def pytest_configure(config: pytest.Config) -> None:
    """Hears the signals that tests send, also below `nohup` and in the background of a script, which ignore them.

    The collector pauses until all tests are collected: it would walk over 500 MB that stay.
    """
    gc.disable()
    _rewrite_a_share(config)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def _rewrite_a_share(config: pytest.Config) -> None:
    """Rewrites a worker's share of the tests for pytest, if nobody has since they were checked out.

    Each worker collects all tests, and would rewrite all of them at the same time: 13 s of CPU. Only whole runs do
    this; what is missing or old is rewritten by pytest as ever.
    """
    worker: dict[str, Any] | None = getattr(config, "workerinput", None)
    if worker is None or not _takes_all(config):
        return
    state = config.stash[rewrite.assertstate_key]
    share = slice(int(worker["workerid"].removeprefix("gw")), None, int(worker["workercount"]))
    for path in sorted(Path(__file__).parent.rglob("test_*.py"))[share]:
        folder = rewrite.get_cache_dir(path)
        cached = folder / f"{path.stem}{rewrite.PYC_TAIL}"
        if not cached.exists() and rewrite.try_makedirs(folder):
            stat, code = rewrite._rewrite_test(path, config)
            rewrite._write_pyc(state, code, stat, cached)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skips folders and files whose tests are deselected anyway; importing them takes each worker seconds."""
    chosen: str = config.option.markexpr
    marker = {"benchmarks": "benchmark", "endurance": "endurance"}.get(collection_path.name)
    if marker and f"not {marker}" in chosen:
        return True
    if not collection_path.match("test_*.py") or not _takes_all(config):
        return None
    text = collection_path.read_text()
    if "not deep" in chosen:
        return True if re.search(r"^pytestmark = .*mark\.deep\b", text, re.MULTILINE) else None
    if chosen.startswith(_DEEPER):
        # Of 580 files 270. Marks that several files share are in their folder's `conftest.py`.
        shared = collection_path.with_name("conftest.py")
        texts = (text, shared.read_text() if shared.exists() else "")
        return None if any(re.search(r"\b(deep|hypothesis)\b", each) for each in texts) else True
    return None


def _takes_all(config: pytest.Config) -> bool:
    """Whether no file or folder is named: one that is, is found, also when all its tests are deselected."""
    return [Path(word) for word in config.args] in ([Path("tests")], [Path(__file__).parent])


def pytest_collection_finish() -> None:
    """Keeps the collector from walking over the collected tests again and again."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(400_000, 20, 50)  # the collector took 31 of 464 CPU seconds of the workers


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    """Waits for threads that watched flow runs of the test: they read the environment, which is put back after it."""
    try:
        return (yield)
    finally:
        watch = sys.modules.get("prefect_robomaker.tasks.execution.run_watch")
        if watch is not None and not watch.WATCH._runs:
            for thread in threading.enumerate():
                if thread.name in ("runs", "dead runs") and not thread.daemon:
                    thread.join(200)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Settings of a service of its own: everything below the test's folder."""
    return Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "home"), "ROBOMAKER_MAX_JOBS": "2"})
