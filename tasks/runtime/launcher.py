"""Starting runs and watching over them, from the process that performs simulation jobs."""

import json
import os
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any

from ...schemas.errors import LaunchError
from ...schemas.simulation_run import RunOutcome, RunPlan
from .logs import log_tail
from .outcomes import Exit, judge
from .progress import Phase
from .video_backends import best_video_backend

DURATION_GRACE_S = 3.0
"""Time a run gets to finish its outputs when its duration limit is reached."""
CANCEL_GRACE_S = 1.0
"""Time a canceled run gets; all of it is gone within two seconds."""
_POLL_S = 0.1
_WARM_UP_TIMEOUT_S = 120.0
_START_TIMEOUT_S = 30.0
_KILL_TIMEOUT_S = 10.0
_INTERNAL = "InternalServiceError"
_FORKSERVER = "prefect_robomaker.tasks.runtime.forkserver"
_KEPT_VARIABLES = frozenset(
    {
        *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "LANG", "LANGUAGE", "TZ", "TMPDIR", "XDG_RUNTIME_DIR"),
        *("LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE"),
        *("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES", "NVIDIA_DRIVER_CAPABILITIES"),
        *("MUJOCO_EGL_DEVICE_ID", "__EGL_VENDOR_LIBRARY_DIRS", "LIBGL_DRIVERS_PATH"),
    }
)
_DEFAULTS = {
    # Runs are parallel to each other; threads inside numpy would only fight over the cores.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # The order of sets of strings is part of what a seed has to repeat.
    "PYTHONHASHSEED": "0",
    "MUJOCO_GL": "disable",
}


class Launcher:
    """Starts runs from one warm process and watches over them; threads may share it.

    The warm process starts with the first run (or `start`) and ends with `close`, with the launcher,
    or with this process, however that ends.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._server: _Server | None = None

    def start(self) -> None:
        """Starts the warm process, unless it runs already.

        Raises:
            LaunchError: It cannot be started.
        """
        with self._lock:
            self._running_server()

    def close(self) -> None:
        """Ends the warm process; runs that are going on are not touched."""
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
        self, plan: RunPlan, stop: Callable[[], str | None], *, clock: Callable[[], float] = time.monotonic
    ) -> RunOutcome:
        """Carries out a run and waits until none of its processes is left.

        Args:
            plan: The run. Its folders are made when they are missing.
            stop: Asked about every 0.1 s whether to stop: None, or why (`canceled`, `timed out (batch)`).
            clock: Seconds, for the duration limit.

        Returns:
            How it ended. The outputs are in the plan's output folder; `result.json` is there only when
            the run came to its end or was stopped in time to write it.

        Raises:
            LaunchError: The run could not be started.
        """
        plan.work_dir.mkdir(parents=True, exist_ok=True)
        plan.output_dir.mkdir(parents=True, exist_ok=True)
        request = _request(plan)
        # Closing this end of the connection, for whatever reason, kills the run.
        with self._connect() as channel:
            channel.send_bytes(request)
            _expect_start(channel)
            started_at = datetime.now(UTC)
            ended, stopped_for = _Watch(channel, plan.max_duration_s, stop, clock).until_end()
        ended_at = datetime.now(UTC)
        judgement = judge(ended, stopped_for, plan, log_tail(plan.output_dir))
        return RunOutcome(
            status=judgement.status,
            failure_code=judgement.failure_code,
            failure_reason=judgement.failure_reason,
            started_at=started_at,
            ended_at=ended_at,
            timed_out=judgement.timed_out,
            finished=ended is not None and ended.ended_by is not None,
        )

    def _connect(self) -> Connection:
        """Has a supervisor forked; returns the connection to it."""
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
    """The warm process, seen from outside."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _FORKSERVER, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env={**_DEFAULTS, **_kept_environment()},
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
        if answer != b"ready":
            self.close()
            why = answer.decode(errors="replace") or f"it ended with exit code {process.returncode}"
            raise LaunchError(f"the process that runs are forked from cannot start: {why}", _INTERNAL)

    def alive(self) -> bool:
        return self._process.poll() is None

    def fork(self, descriptor: int) -> None:
        try:
            socket.send_fds(self._control, [b"r"], [descriptor])
        except OSError as error:
            raise LaunchError(f"the process that runs are forked from does not listen: {error}", _INTERNAL) from error


def _end_server(process: "subprocess.Popen[bytes]", control: socket.socket) -> None:
    control.close()
    try:
        process.wait(2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class _Watch:
    """Watches one run: its end, its duration, whoever wants it stopped."""

    def __init__(
        self, channel: Connection, max_duration_s: float, stop: Callable[[], str | None], clock: Callable[[], float]
    ) -> None:
        self._channel = channel
        self._stop = stop
        self._clock = clock
        self._deadline = clock() + max_duration_s
        self._stopped_for: str | None = None
        self._due: list[tuple[float, dict[str, Any]]] = []
        """What is still to be sent, with the time from which on."""

    def until_end(self) -> tuple[Exit | None, str | None]:
        """Returns how the process ended (None: unknown) and why it was stopped (None: it was not)."""
        while not self._channel.poll(self._patience()):
            if self._stopped_for is None:
                self._look_for_reason_to_stop()
            self._send_what_is_due()
            if self._stopped_for is not None and not self._due:
                self._channel.poll(_KILL_TIMEOUT_S)
                break
        return _read_exit(self._channel), self._stopped_for

    def _patience(self) -> float:
        next_s = self._due[0][0] if self._due else self._deadline
        return min(_POLL_S, max(0.0, next_s - self._clock()))

    def _look_for_reason_to_stop(self) -> None:
        if self._clock() >= self._deadline:
            self._begin_stop("duration limit", "duration limit", DURATION_GRACE_S)
        elif (reason := self._stop()) is not None:
            self._begin_stop(reason, "canceled", CANCEL_GRACE_S)

    def _begin_stop(self, reason: str, told: str, grace_s: float) -> None:
        self._stopped_for = reason
        now = self._clock()
        # Asked twice: the second time interrupts application code that does not return.
        self._due = [(now, {"stop": told}), (now + grace_s / 2, {"stop": told}), (now + grace_s, {"kill": True})]

    def _send_what_is_due(self) -> None:
        while self._due and self._clock() >= self._due[0][0]:
            _, message = self._due.pop(0)
            try:
                self._channel.send_bytes(json.dumps(message).encode())
            except OSError:
                return  # it has just ended; the loop sees that next


def _request(plan: RunPlan) -> bytes:
    backend = best_video_backend() if plan.video != "none" else None
    variables: dict[str, str] = {}
    for application in (plan.robot_application, plan.simulation_application):
        variables |= application.environment_variables if application else {}
    if backend in ("egl", "osmesa"):
        variables.setdefault("MUJOCO_GL", backend)
    environment = {
        **_DEFAULTS,
        **_kept_environment(),
        **plan.environment,
        **variables,
        "PWD": str(plan.work_dir),
        "AWS_ROBOMAKER_SIMULATION_JOB_ID": plan.job_id,
        "AWS_ROBOMAKER_SIMULATION_JOB_ARN": plan.job_arn,
        "AWS_ROBOMAKER_SIMULATION_RUN_ID": plan.run_id,
    }
    # Paths become absolute here, where relative ones still mean what the caller meant.
    plain = _absolute_paths(plan)
    request = {
        "plan": plain.model_dump(mode="json"),
        "environment": environment,
        "import_path": [str(Path(entry).absolute()) for entry in sys.path],
        "video_backend": backend,
    }
    return json.dumps(request).encode()


def _absolute_paths(plan: RunPlan) -> RunPlan:
    folders = {
        name: value.absolute()
        for name in ("world_dir", "data_dir", "root_dir", "work_dir", "output_dir")
        if (value := getattr(plan, name)) is not None
    }
    applications = {
        name: application.model_copy(update={"path": application.path.absolute()})
        for name in ("simulation_application", "robot_application")
        if (application := getattr(plan, name)) is not None and application.path is not None
    }
    return plan.model_copy(update={**folders, **applications})


def _kept_environment() -> dict[str, str]:
    """This process's variables that runs may see: no credentials, no settings of services."""
    return {key: value for key, value in os.environ.items() if key in _KEPT_VARIABLES or key.startswith("LC_")}


def _expect_start(channel: Connection) -> None:
    try:
        if channel.poll(_START_TIMEOUT_S):
            channel.recv_bytes()
            return
    except (EOFError, OSError) as error:
        raise LaunchError("the run's supervisor ended before the run began", _INTERNAL) from error
    raise LaunchError(f"the run did not begin within {_START_TIMEOUT_S:g} s", _INTERNAL)


def _read_exit(channel: Connection) -> Exit | None:
    try:
        message = json.loads(channel.recv_bytes()) if channel.poll() else None
    except (EOFError, OSError):
        return None
    if message is None:
        return None
    return Exit(message["exit_code"], message["signal"], Phase(message["phase"]), message["report"])
