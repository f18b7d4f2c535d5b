"""Resumes interrupted runs in the background, each in a process of its own, which outlives this one.

Every process of the home that may run jobs does this: `robomaker serve`, Prefect workers, the runs of those, and
`robomaker run`, `perform` and `work`. The lock of a run decides which of them takes it.
"""

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from ...schemas.reports.run_record import Order
from ...schemas.settings import Settings
from .broken_off import BrokenOff, broken_off_runs
from .missed_nights import has_schedules
from .open_runs import LOG, OpenRun, is_going

PROGRAM = "prefect_robomaker.deployments.cli.ordered_run"
CONTINUED = "continued"
"""Second word in the command line of a process that resumes a run, by which people recognise it."""

EVERY_S = 5.0
"""Interval between two searches for interrupted runs, in seconds; a search only lists the folders of runs."""

_MISSED_EVERY_S = 60.0
"""Interval between two searches for missed nights, in seconds: two requests to Prefect for each schedule."""

_NONE_KNOWN_EVERY_S = 600.0
"""Interval between two searches for missed nights if no schedule is known, in seconds.

Prefect may have a schedule of which no run has begun yet.
"""

_FIRST_ITS_WORKER_S = 20.0
"""Time in seconds that an interrupted run of a deployment is left to its Prefect worker, which has its variables."""

_PAUSES_S = (60.0, 600.0)
"""Pauses before a run that died again is resumed, in seconds: the missing resource may be there then."""

_PREFECTS = "PREFECT__"
"""Prefix of environment variables that tell a process which flow run it executes."""

_MOST_AT_ONCE = 4
"""Limit of runs that are resumed at the same time.

Each is a process of some 200 MB, and their jobs share the machine.
"""

_CLAIMED_WITHIN_S = 60.0
"""Time in seconds that a flow run in a container waits at its end for runs to resume.

The first search leaves such runs to their Prefect worker for 20 s.
"""

_logger = logging.getLogger(__name__)

OrderFlowRun = Callable[[Order], bool]
"""Function that makes a Prefect worker resume the run of a deployment; returns whether it will."""

Tell = Callable[[BrokenOff], None]
"""Function that tells users, in Prefect, how a run is resumed that is not resumed automatically."""


class TakingUp:
    """Looks for interrupted runs, and starts processes that resume them.

    Args:
        settings: Settings of this process.
        variables: Environment variables for the processes that finish runs, besides those of this one.
        order_flow_run: Has a Prefect worker finish the run of a deployment; `None`: this process cannot.
        tell: Called once for each run that is not resumed; `None`: it is only logged.
        look_for_missed: Looks for nights that did not happen; called once a minute if any schedule is looked after,
            else every ten minutes.
    """

    def __init__(
        self,
        settings: Settings,
        variables: Mapping[str, str] | None = None,
        order_flow_run: OrderFlowRun | None = None,
        tell: Tell | None = None,
        look_for_missed: Callable[[], None] | None = None,
    ) -> None:
        self._settings = settings
        self._variables = variables or {}
        self._order_flow_run = order_flow_run
        self._tell = tell
        self._look_for_missed = look_for_missed
        self._seen_at: dict[tuple[str, int], float] = {}
        self._told: set[tuple[str, str]] = set()
        self._ordered: set[tuple[str, int]] = set()
        self._started: dict[str, Path] = {}
        self._looking = threading.Lock()

    def start(self) -> None:
        """Starts a thread that looks for interrupted runs again and again."""
        threading.Thread(target=self._look_until_end, name="broken-off runs", daemon=True).start()

    def look(self) -> list[str]:
        """Looks once for interrupted runs, and starts to resume them.

        Returns:
            Ids of the runs that are being finished from now on.
        """
        with self._looking:  # a run that is claimed is started, or neither, for `wait_in_container`
            return [run.run_id for run in broken_off_runs(self._settings) if self._take(run)]

    def wait_in_container(self) -> None:
        """Waits for the resumed runs if this process is a flow run in its own container.

        All processes of a container die with its first one, which is the flow run: each night would take up the run
        that broke off, and none would finish it.
        """
        if not _ends_with_container():
            return
        began = time.monotonic()
        while self._has_to_wait(time.monotonic() - began):
            time.sleep(1.0)

    def _has_to_wait(self, waited_s: float) -> bool:
        with self._looking:
            return self._is_finishing() or (waited_s < _CLAIMED_WITHIN_S and self._will_take_any())

    def _is_finishing(self) -> bool:
        return any(map(is_going, self._started.values()))

    def _will_take_any(self) -> bool:
        return any(
            self._is_for_this_home(run) and not run.why_left and not _is_too_soon(run)
            for run in broken_off_runs(self._settings)
        )

    def _is_for_this_home(self, run: BrokenOff) -> bool:
        """Whether this process may resume a run; otherwise a server with the user's access key does."""
        return run.order.key_id is None or self._settings.access_keys_file is not None

    def _look_until_end(self) -> None:
        missed, looked_at = self._look_for_missed, 0.0
        told: set[str] = set()
        while True:
            _try(self.look, "runs that broke off", told)
            every_s = _MISSED_EVERY_S if has_schedules(self._settings.home) else _NONE_KNOWN_EVERY_S
            if missed is not None and (not looked_at or time.monotonic() - looked_at > every_s):
                looked_at = time.monotonic()
                _try(missed, "nights that did not happen", told)
            time.sleep(EVERY_S)

    def _take(self, run: BrokenOff) -> bool:
        if not self._is_for_this_home(run):
            return False
        key = (run.run_id, len(run.order.interruptions))
        seen_at = self._seen_at.setdefault(key, time.monotonic())
        if run.order.deployment is not None:
            if key in self._ordered:
                return False  # it waits for its Prefect worker
            if not run.limits and self._order_flow_run is not None and self._order_flow_run(run.order):
                self._ordered.add(key)
                _logger.warning("%s broke off; its Prefect worker finishes it", run.run_id)
                return True
            if time.monotonic() - seen_at < _FIRST_ITS_WORKER_S:
                return False
        if run.why_left:
            self._leave(run)
            return False
        if _is_too_soon(run):
            return False
        self._started = {run_id: folder for run_id, folder in self._started.items() if is_going(folder)}
        if len(self._started) >= _MOST_AT_ONCE:
            return False
        if (claimed := OpenRun.claim(run.folder)) is None:
            return False
        start_process(claimed, self._variables, CONTINUED)
        self._started[run.run_id] = run.folder
        _logger.warning("%s broke off, and is finished now", run.run_id)
        return True

    def _leave(self, run: BrokenOff) -> None:
        if (run.run_id, run.why_left) in self._told:
            return
        self._told.add((run.run_id, run.why_left))
        _logger.warning("%s; go on with it %s%s", run.in_words(), run.place, run.command)
        if self._tell is not None:
            self._tell(run)


def _try(look: Callable[[], object], what: str, told: set[str]) -> None:
    """Runs one search; errors are logged once and end nothing, as a later search may succeed."""
    try:
        look()
        told.discard(what)
    except Exception as error:
        if what not in told:
            _logger.warning("%s are not looked for: %s: %s", what, type(error).__name__, error)
            told.add(what)


def _ends_with_container() -> bool:
    """Whether the container's first process is a flow run of Prefect, so that the container ends with it."""
    try:
        return any(
            word.startswith(b"PREFECT__FLOW_RUN_ID=") for word in Path("/proc/1/environ").read_bytes().split(b"\0")
        )
    except OSError:
        return False  # it is another user's: a machine's own


def _is_too_soon(run: BrokenOff) -> bool:
    tried = run.order.interruptions
    if not tried:
        return False
    pause_s = _PAUSES_S[min(len(tried), len(_PAUSES_S)) - 1]
    return (datetime.now(UTC) - tried[-1].continued_at).total_seconds() < pause_s


def start_process(run: OpenRun, variables: Mapping[str, str], *words: str) -> None:
    """Starts the process that resumes a run, which inherits the run's lock.

    Args:
        run: The run.
        variables: Environment variables besides those of this process.
        words: More words of its command line.
    """
    with (run.folder / LOG).open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", PROGRAM, str(run.lock), *words],
            pass_fds=[run.lock],
            # Not that of the flow run which this process may carry out.
            env={**{name: value for name, value in os.environ.items() if not name.startswith(_PREFECTS)}, **variables},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=log,
            start_new_session=True,  # Ctrl-C in a terminal is for the program there alone
        )
    order = run.order.model_dump_json().encode()
    run.pass_on()
    # A thread: the process reads its input only when it is ready, and has to be waited for when it ends.
    threading.Thread(target=process.communicate, args=(order,), daemon=True).start()
