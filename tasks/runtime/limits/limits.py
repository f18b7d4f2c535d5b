"""Resource limits of a run, and detection of exceeded limits.

The kernel enforces the limit of cores. Memory and the number of processes are summed over the whole process tree ten
times a second, which needs no privileges and works wherever there is a `/proc`.
"""

import os
import resource
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ....schemas.runs.programs import ComputeLimits
from .processes import ProcessState, descendants_of, proportional_bytes, written_bytes

METER_INTERVAL_S = 0.1
_OOM_SCORE = 500
"""OOM score adjustment of runs: when the machine runs out of memory, the kernel kills them before job workers."""
_MANY = 64
_PATIENCE_S = 0.03
_MAX_PATIENCE_S = 1.0
"""Seconds after which a memory measurement that has not finished is replaced by an estimate."""
_OTHER_FORKS = 512
"""Number of processes of the same user, outside the run, that may be added while it runs."""


@dataclass(frozen=True)
class Excess:
    """An exceeded resource limit of a run as text, and the process session that is to blame."""

    text: str
    """Message with the limit and the use."""

    session: int
    """Session id of the processes that used most."""


def apply_limits(limits: ComputeLimits, cores: list[int] | None) -> None:
    """Applies the run's limits that the kernel enforces (cores, priority, processes) to this process and its children.

    Core dumps are turned off, and the kernel chooses these processes first when memory runs out.

    Args:
        limits: Limits of the run.
        cores: Numbers of the cores that the run may use; None: all.
    """
    if cores is not None:
        with suppress(OSError):  # a core may have been taken away in the meantime
            os.sched_setaffinity(0, cores)
    if limits.nice > os.getpriority(os.PRIO_PROCESS, 0):
        os.setpriority(os.PRIO_PROCESS, 0, limits.nice)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(str(_OOM_SCORE))
    if limits.processes is not None:
        _bound_forks(limits.processes)


def _bound_forks(processes: int) -> None:
    """Limits the number of the user's processes, as a last resort against fork bombs.

    The limit is well above that of the run, since it counts all processes of the user. It does not apply to root; a
    supervisor then gets the highest priority (`processes.come_first`).
    """
    with suppress(OSError, ValueError, IndexError):
        there = int(Path("/proc/loadavg").read_text().split()[3].split("/")[1])
        _, hard = resource.getrlimit(resource.RLIMIT_NPROC)
        bound = there + processes + _OTHER_FORKS
        if hard == resource.RLIM_INFINITY or bound < hard:
            resource.setrlimit(resource.RLIMIT_NPROC, (bound, bound))


class Meter:
    """Measures memory and number of a run's processes, and compares them to the limits.

    Args:
        limits: Limits of the run.
        others: Processes below this one that do not belong to the run.
    """

    def __init__(self, limits: ComputeLimits, others: frozenset[int] = frozenset()) -> None:
        self.interval_s = METER_INTERVAL_S
        """Seconds until the next check; short while the number of processes grows fast."""

        self._limits = limits
        self._others = others
        self._count = 0
        self._scales = _Scales()

    def look(self) -> Excess | None:
        """Measures the processes, threads and memory of this process's descendants, and returns the exceeded limit.

        Returns `None` if none is exceeded. Sets the time until the next measurement, shorter if many processes were
        started.
        """
        states = []
        count = 0
        limit = self._limits.processes
        for state in descendants_of(os.getpid()):
            if state.pid in self._others or state.state == "Z":
                continue
            states.append(state)
            count += state.threads
            if limit is not None and count > limit:  # a bomb is not counted to its end
                use = f"{limit} processes and threads at once are allowed, and there were more"
                return Excess(use, _most(states, {state.pid: state.threads for state in states}))
        self.interval_s = METER_INTERVAL_S / 10 if count > self._count + _MANY else METER_INTERVAL_S
        self._count = count
        return self._memory_excess(states)

    def busiest_writer(self) -> int:
        """Returns the process session below this process that has written most to disk; 0 if none is left."""
        states = [state for state in descendants_of(os.getpid()) if state.pid not in self._others]
        return _most(states, {state.pid: written_bytes(state.pid) for state in states}) if states else 0

    def _memory_excess(self, states: list[ProcessState]) -> Excess | None:
        limit = self._limits.memory_bytes
        # Resident memory counts shared pages once per process: never too little, and cheap.
        if limit is None or sum(state.resident_bytes for state in states) <= limit:
            return None
        weighed = self._scales.weigh(states)
        if weighed is None:
            return None
        states, exact = weighed
        total = sum(exact.values())
        if total <= limit:
            return None
        use = f"{_in_mib(limit)} MiB of memory are allowed, and it used {_in_mib(total)} MiB"
        return Excess(use, _most(states, exact))


Weighed = tuple[list[ProcessState], dict[int, int]]


class _Scales:
    """Measures the memory of processes exactly, in a thread.

    The kernel answers only while a process is not changing its memory. One that forks without end may never be
    measured, and must not block a supervisor.
    """

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._began_s = 0.0
        self._states: list[ProcessState] = []
        """Processes whose memory is measured, the largest first."""
        self._exact: list[int] = []
        """Measured memory of the first processes in `_states`, in bytes."""

    def weigh(self, states: list[ProcessState]) -> Weighed | None:
        """Returns measured processes and the memory of each in bytes, perhaps slightly outdated; `None` while unknown.

        The exact measurement goes on in a thread; if it takes too long while processes are started, estimates are
        returned.
        """
        if self._thread is None:
            self._began_s = time.monotonic()
            self._states = sorted(states, key=lambda state: state.resident_bytes, reverse=True)
            self._exact = []
            self._thread = threading.Thread(target=self._weigh, args=[self._states, self._exact], daemon=True)
            self._thread.start()
        self._thread.join(_PATIENCE_S)
        if not self._thread.is_alive():
            self._thread = None
        elif time.monotonic() - self._began_s < _MAX_PATIENCE_S:
            return None
        elif {state.pid for state in states} - {state.pid for state in self._states}:
            # It goes on forking: there is no time to find out that all of them are small.
            return states, {state.pid: state.resident_bytes for state in states}
        return self._states, estimated_bytes(self._states, list(self._exact))

    @staticmethod
    def _weigh(states: list[ProcessState], exact: list[int]) -> None:
        for state in states:
            exact.append(_exact_bytes(state))  # noqa: PERF401 - it is read meanwhile


def estimated_bytes(states: list[ProcessState], exact: list[int]) -> dict[int, int]:
    """Returns the memory of processes in bytes, by process id, estimated where it was not measured exactly.

    The process that is being measured may never be finished, and counts with its maximum. The others are assumed to
    share as much memory as those before them: of hundreds of forks of one process, each has its resident memory, but
    all together have it once.

    Args:
        states: States of the processes.
        exact: Exact memory of the first of the processes.
    """
    resident = sum(state.resident_bytes for state in states[: len(exact)])
    share = sum(exact) / resident if resident else 1.0
    rest = states[len(exact) :]
    guesses = [state.resident_bytes if state is rest[0] else round(share * state.resident_bytes) for state in rest]
    return {state.pid: size for state, size in zip(states, [*exact, *guesses], strict=True)}


def _exact_bytes(state: ProcessState) -> int:
    exact = proportional_bytes(state.pid)
    return state.resident_bytes if exact is None else exact


def _most(states: list[ProcessState], use: dict[int, int]) -> int:
    """Returns the session whose processes together have the largest use.

    Args:
        states: The processes; at least one.
        use: Use of each process, by its id, such as bytes of memory or number of threads.
    """
    totals: dict[int, int] = {}
    for state in states:
        totals[state.session] = totals.get(state.session, 0) + use[state.pid]
    return max(totals, key=totals.__getitem__)


def _in_mib(count: int) -> int:
    return round(count / 2**20)
