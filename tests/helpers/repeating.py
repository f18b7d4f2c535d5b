"""How to repeat what failed: the seed, and the tests that the same worker had run before, in their order."""

import os
import shlex
from pathlib import Path

import pytest

KEPT_FOLDER = "ROBOMAKER_TESTS_KEEP"
"""Environment variable: the folder that gets a file for each test that failed; absent: none is written."""

_RUN = pytest.StashKey[dict[str, list[str]]]()
_FAILED = pytest.StashKey[dict[str, str]]()


def pytest_configure(config: pytest.Config) -> None:
    """Begins the lists, in the process that hears of all tests."""
    if not hasattr(config, "workerinput"):
        config.stash[_RUN] = {}
        config.stash[_FAILED] = {}
        config.pluginmanager.register(_Listener(config), "robomaker-repeating")


class _Listener:
    def __init__(self, config: pytest.Config) -> None:
        self._run = config.stash[_RUN]
        self._failed = config.stash[_FAILED]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Notes which worker ran a test, and whether it failed."""
        node = getattr(report, "node", None)  # of xdist
        worker = node.gateway.id if node is not None else "main"
        if report.when == "setup":
            self._run.setdefault(worker, []).append(report.nodeid)
        if report.failed:
            self._failed.setdefault(report.nodeid, worker)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Prints the seed again after failures, and keeps the order of tests that led to each."""
    failed = config.stash.get(_FAILED, {})
    if not failed:
        return
    seed = config.getoption("randomly_seed", None)
    terminalreporter.section("how to repeat it")
    folder = os.environ.get(KEPT_FOLDER)
    options = f"-m {shlex.quote(config.option.markexpr)} --randomly-seed={seed}"
    if profile := config.getoption("--hypothesis-profile", None):
        options += f" --hypothesis-profile={profile}"
    for number, (test, worker) in enumerate(failed.items()):
        terminalreporter.write_line(f"pytest -n 0 {options} {shlex.quote(test)}")
        if folder is not None:
            before = config.stash[_RUN][worker]
            path = Path(folder) / f"failed-{number}.txt"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("\n".join([*before[: before.index(test)], test, ""]))
            again = f"pytest -n 0 {options} --randomly-dont-reorganize @{path}"
            terminalreporter.write_line(f"    after the tests that {worker} ran before it: {again}")
