"""Launcher of runs: client of the fork server."""

import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from types import TracebackType

from ....schemas.runs.plan import RunOutcome, RunPlan
from ....schemas.runs.programs import BoxPlan, RunStop
from ....schemas.runs.trial_rows import judged_of
from ....schemas.runs.variables import ENDPOINT_VARIABLE
from ....schemas.settings import Settings
from ....schemas.wire.errors import LaunchError, LaunchInterruptedError
from ..limits.disk_use import found_files
from ..limits.logs import log_tail, note_screens
from ..process.run_request import RunRequest
from ..sandbox.levels import Confinement
from ..states.checkpoint_files import wall_time_used_s
from ..video.failure_videos import is_filmed, record_failure_videos
from .finished_outputs import finish_outputs, read_result
from .forkserver import READY, SANDBOX_VARIABLE
from .recorded_verdicts import judge_topics
from .ros_topics import join_ros_topics
from .run_outcomes import Exit, Outcome, attribute_disk_use, decide_outcome, never_connected, was_killed
from .run_requests import DEFAULT_VARIABLES, Cores, inherited_environment, make_request, plan_box, program_environment
from .stop_monitor import OnTrials, StopMonitor
from .unseen_programs import unseen_programs

_WARM_UP_TIMEOUT_S = 120.0
_START_TIMEOUT_S = 30.0
_CLEAN_UP_TIMEOUT_S = 10.0
_INTERNAL = "InternalServiceError"
_FORKSERVER = "prefect_robomaker.tasks.runtime.supervision.forkserver"
OnCrash = Callable[[str, str], None]
"""Function that is called with failure code and reason when a run crashes."""


class Launcher:
    """Launcher of simulation runs: forks them from one fork server process, and supervises them; threads may share it.

    The fork server has imported all modules that runs need. It starts with the first run (or `start`). It ends with
    `close`, with the launcher object, or with this process, however that ends.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._server: _Server | None = None
        self._cores = Cores()

    def start(self) -> None:
        """Starts the fork server process, unless it is running.

        Raises:
            LaunchError: The process cannot be started.
        """
        with self._lock:
            self._running_server()

    def close(self) -> None:
        """Ends the fork server process, if it runs; current runs continue."""
        with self._lock:
            if self._server is not None:
                self._server.close()
                self._server = None

    def __enter__(self) -> "Launcher":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(
        self,
        plan: RunPlan,
        stop: Callable[[], RunStop | None],
        *,
        on_crash: OnCrash | None = None,
        on_trials: OnTrials = lambda *_: None,
        on_answering: Callable[[], None] = lambda: None,
        on_stopped: Callable[[], None] = lambda: None,
        on_simulated: Callable[[bool], None] = lambda _: None,
        try_again: Callable[[], bool] = lambda: False,
        adjust: Callable[[RunRequest], RunRequest] = lambda request: request,
        clock: Callable[[], float] = time.monotonic,
    ) -> RunOutcome:
        """Runs a simulation, and waits until all its processes have ended.

        Args:
            plan: Plan of the run. Missing folders are created.
            stop: Function called about every 0.2 s; returns a reason to stop the run, or None.
            on_crash: Called once with failure code and reason, when a program crashed in a run whose failure behaviour
                is `Continue`. The run continues until it is stopped or reaches its duration limit, and fails then.
            on_trials: Called from time to time with the number of finished trials, and how far recording some again is.
            on_answering: Called once applications listen on all forwarded ports, or 10 s after they were started; never
                if no port is forwarded.
            on_stopped: Called when all processes have ended, before the outputs are read.
            on_simulated: Called when the run has ended and its result is written; the argument says whether videos of a
                failure follow.
            try_again: Called when the run was killed from outside; if it returns true, the outputs are left unchanged.
            adjust: Changes what the run's processes find on this machine: variables, processors, box.
            clock: Monotonic clock in seconds, for the duration limit.

        Returns:
            Outcome of the run. The outputs are in the plan's output folder; `result.json` exists only if
            the run ended by itself, or was stopped in time to write it.

        Raises:
            LaunchError: The run could not be started.
        """
        plan.work_dir.mkdir(parents=True, exist_ok=True)
        plan.output_dir.mkdir(parents=True, exist_ok=True)
        note_screens(plan)
        if plan.found is None:  # a run that goes on from a checkpoint knows
            plan = plan.model_copy(update={"found": found_files(plan)})
        left_s = max(0.0, plan.max_duration_s - wall_time_used_s(plan))  # an earlier attempt may have been killed
        with self._cores.taken(plan.compute.cpus) as cores:
            request = adjust(make_request(plan, cores, self._box()))
            crash = _FirstCrash(request, on_crash)
            # Closing this end of the connection, for any reason, kills the run.
            with self._connect() as channel:
                _begin(channel, request)
                started_at = datetime.now(UTC)
                monitor = StopMonitor(channel, left_s, stop, crash.on_crash, on_trials, on_answering, clock)
                ended, stopped_for = monitor.until_end()
        ended_at = datetime.now(UTC)
        if ended is None:
            _clean_up(request)
        on_stopped()
        if ended is not None and stopped_for is None:
            ended = attribute_disk_use(ended, plan)
        decided = crash.outcome(stopped_for) or decide_outcome_with_log(ended, stopped_for, request)
        if was_killed(ended, stopped_for) and try_again():
            return RunOutcome(**asdict(decided), started_at=started_at, ended_at=ended_at, was_killed=True)
        decided, finished = finish_outputs(plan, ended, decided, (started_at, ended_at))
        variables = {**DEFAULT_VARIABLES, **inherited_environment()}
        losses = join_ros_topics(plan, is_canceled=decided.status == "Canceled", stop=stop, environment=variables)
        if decided.status == "Completed":
            judge_topics(plan, losses, timed_out=decided.timed_out, stop=stop, environment=variables)
        result = read_result(plan.output_dir) if decided.status == "Completed" else None
        outcome = RunOutcome(
            **asdict(decided),
            verdict=result.verdict if result else None,
            verdict_reason=result.reason if result else None,
            judged=judged_of(result) if result else None,
            started_at=started_at,
            ended_at=ended_at,
            cpu_time_s=ended.cpu_time_s if ended else None,
            finished=finished,
        )
        is_drawn = is_filmed(plan, outcome)
        on_simulated(is_drawn)
        limit_s = Settings.from_environment(os.environ).failure_video_limit_s
        began_s = clock()
        record_failure_videos(plan, outcome, stop, variables, limit_s=limit_s)
        return outcome.model_copy(update={"video_s": round(clock() - began_s, 3)}) if is_drawn else outcome

    def _box(self) -> BoxPlan:
        with self._lock:
            confinement = self._running_server().confinement
        settings = Settings.from_environment(os.environ)
        return plan_box(settings, confinement, endpoint=os.environ.get(ENDPOINT_VARIABLE))

    def _connect(self) -> Connection:
        """Lets the fork server fork a supervisor process, and returns the connection to it."""
        ours, theirs = socket.socketpair()
        with ours, theirs, self._lock:
            self._running_server().fork(theirs.fileno())
            return Connection(ours.detach())

    def _running_server(self) -> "_Server":
        if self._server is None or not self._server.alive():
            if self._server is not None:
                self._server.close()
            self._server = _Server()
        return self._server


class _Server:
    """Fork server process that this process has started, which forks the supervisors of runs on request."""

    def __init__(self) -> None:
        ours, theirs = map(_above_standard, socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET))
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _FORKSERVER, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env={
                    **DEFAULT_VARIABLES,
                    **inherited_environment(),
                    SANDBOX_VARIABLE: os.environ.get(SANDBOX_VARIABLE, ""),
                },
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C in a terminal is for us to handle
            )
        self._process, self._control = process, ours
        self.close = weakref.finalize(self, _end_server, process, ours)
        ours.settimeout(_WARM_UP_TIMEOUT_S)
        try:
            answer = ours.recv(8192)
        except TimeoutError:
            answer = f"it was not ready after {_WARM_UP_TIMEOUT_S:g} s".encode()
        if not answer.startswith(READY):
            self.close()
            why = answer.decode(errors="replace") or f"it ended with exit code {process.returncode}"
            kind = LaunchInterruptedError if process.returncode == -signal.SIGKILL else LaunchError
            raise kind(f"the process that runs are forked from cannot start: {why}", _INTERNAL)
        self.confinement = Confinement(*json.loads(answer.removeprefix(READY)))
        """Sandbox level of runs on this machine."""

    def alive(self) -> bool:
        return self._process.poll() is None

    def fork(self, descriptor: int) -> None:
        try:
            socket.send_fds(self._control, [b"r"], [descriptor])
        except OSError as error:
            raise LaunchInterruptedError(
                f"the process that runs are forked from does not listen: {error}", _INTERNAL
            ) from error


def _above_standard(connection: socket.socket) -> socket.socket:
    """Returns a socket on a descriptor above standard input, output and error, and closes the given one."""
    with connection:
        return socket.socket(fileno=fcntl.fcntl(connection.fileno(), fcntl.F_DUPFD_CLOEXEC, 3))


def _end_server(process: "subprocess.Popen[bytes]", control: socket.socket) -> None:
    control.close()
    try:
        process.wait(2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class _FirstCrash:
    """Outcome of the first crash of a program in a run that goes on nevertheless; later crashes change nothing."""

    def __init__(self, request: RunRequest, on_crash: OnCrash | None) -> None:
        self._request = request
        self._on_crash = on_crash
        self._outcome: Outcome | None = None

    def on_crash(self, crashed: Exit) -> None:
        """Determines the outcome of a crash while its log is fresh, keeps it, and reports failure code and reason."""
        self._outcome = decided = decide_outcome_with_log(crashed, None, self._request)
        if self._on_crash is not None:
            self._on_crash(decided.failure_code or _INTERNAL, decided.failure_reason or "")

    def outcome(self, stopped_for: RunStop | None) -> Outcome | None:
        """Returns the run's outcome if a program of it crashed (failed, unless it was cancelled later), else `None`."""
        if self._outcome is None or stopped_for in (None, RunStop.DURATION_LIMIT):
            return self._outcome
        return decide_outcome(None, stopped_for, self._request.plan)


def decide_outcome_with_log(ended: Exit | None, stopped_for: RunStop | None, request: RunRequest) -> Outcome:
    """Returns how a run ended, with the last log lines of the program concerned in a failure's reason.

    The end is `None` if the run's supervisor disappeared; the reason for a stop is `None` if the run ended by itself.
    """
    plan = request.plan
    program = ended.crash.program if ended is not None and ended.crash is not None else None
    if ended is not None and program is None and never_connected(ended):
        program = next(
            (each.name for each in plan.programs if (each.role, each.kind) == ("robot", "application")), None
        )
    log = log_tail(plan.output_dir, program, ended.logged_bytes.get(program or "") if ended is not None else None)
    decided = decide_outcome(ended, stopped_for, plan, log)
    is_boxed = not any(each.name == program and each.cleanup_argv is not None for each in plan.programs)
    unseen = unseen_programs(request, decided.failure_reason or "") if is_boxed else ""
    return decide_outcome(ended, stopped_for, plan, log, unseen) if unseen else decided


def _clean_up(request: RunRequest) -> None:
    """Runs the clean-up commands of a run's programs, such as removing containers, as its supervisor has died.

    Their failures are ignored, and each gets limited time.
    """
    for program in request.plan.programs:
        if program.cleanup_argv is not None:
            with suppress(OSError, subprocess.TimeoutExpired):
                subprocess.run(
                    program.cleanup_argv,
                    env=program_environment(request, program),
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    timeout=_CLEAN_UP_TIMEOUT_S,
                    check=False,
                )


def _begin(channel: Connection, request: RunRequest) -> None:
    """Sends a run's request to its supervisor, and waits until the run has begun.

    Raises `LaunchError` if the supervisor refuses the run or does not begin it in time, and `LaunchInterruptedError` if
    the supervisor ended.
    """
    try:
        channel.send_bytes(request.model_dump_json().encode())
        if channel.poll(_START_TIMEOUT_S):
            message = json.loads(channel.recv_bytes())
            if message["event"] == "refused":
                raise LaunchError(message["reason"], message["code"])
            return
    except (EOFError, OSError) as error:
        raise LaunchInterruptedError("the run's supervisor ended before the run began", _INTERNAL) from error
    raise LaunchError(f"the run did not begin within {_START_TIMEOUT_S:g} s", _INTERNAL)
