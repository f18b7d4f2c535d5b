"""Programs of a run: starts and restarts them, and watches their logs for failed ROS launches."""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from ....schemas.runs.programs import ProgramPlan, ToolEnds
from ..limits.logs import LOG_FOLDER, CappedLog, program_logs
from ..sandbox.box import fork_beside

_CHUNK_BYTES = 256 * 1024
"""Maximum number of bytes read from a log at a time."""
_COLOURS = re.compile(rb"\x1b\[[0-9;]*m")
_STAMP = rb"^(?:\d+\.\d+ )?"
_CANNOT = re.compile(rb"^ERROR: (cannot launch node of type .*)")
_REQUIRED_1 = re.compile(rb"^=*(REQUIRED process \[[^\]]*\] has died!)")
_EXCEPTION = re.compile(
    _STAMP
    + rb"\[ERROR\] \[launch\]: (Caught (?:exception|multiple exceptions) (?:in launch|when trying to load file).*)"
)
_NOT_EXECUTED = re.compile(_STAMP + rb"\[ERROR\] \[([^\]]+)\]: exception occurred while executing process:")
_DIED_2 = re.compile(_STAMP + rb"\[ERROR\] \[([^\]]+)\]: (process has died .*)")
_REQUIRED_2 = re.compile(_STAMP + rb"\[INFO\] \[launch\]: process\[([^\]]+)\] was required: shutting down")
_TRACEBACK = (b" ", b"\t", b"Traceback ")


class LaunchWatch:
    """Watches a ROS launch program's log for nodes that failed to start or died.

    Args:
        descriptor: File descriptor of the log.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._offset = self._size()
        self._part = b""
        self._died: dict[bytes, bytes] = {}
        """Names of ROS 2 nodes that died, each with the log line that says so."""
        self._awaited: Callable[[bytes], bytes | None] | None = None
        """Function that handles the log line after an ambiguous one; None: no such line is awaited."""

    def look(self) -> str | None:
        """Returns the first new log line that reports a failed launch or a dead required node, `None` without one."""
        found = (self._failure_in(line) for line in self._new_lines())
        said = next((each for each in found if each is not None), None)
        return None if said is None else said.decode(errors="replace").strip()

    def _failure_in(self, line: bytes) -> bytes | None:
        if self._awaited is not None:
            return self._awaited(line)
        if (found := _CANNOT.match(line) or _EXCEPTION.match(line)) is not None:
            return found[1]
        if (found := _REQUIRED_1.match(line)) is not None:
            self._awaited = lambda next_line, said=found[1]: self._after_required(said, next_line)
        elif (found := _NOT_EXECUTED.match(line)) is not None:
            self._awaited = lambda next_line, node=found[1]: self._after_traceback(node, next_line)
        elif (found := _DIED_2.match(line)) is not None:
            self._died[found[1]] = found[2]
        elif (found := _REQUIRED_2.match(line)) is not None and found[1] in self._died:
            return b"required node %s: %s" % (found[1], self._died[found[1]])
        return None

    def _after_required(self, said: bytes, line: bytes) -> bytes | None:
        """Returns the failure of a required node whose end was logged, or `None` if this line calls its end clean."""
        self._awaited = None
        return b"%s %s" % (said, line) if line.startswith(b"process has died") else None

    def _after_traceback(self, node: bytes, line: bytes) -> bytes | None:
        if not line.strip() or line.startswith(_TRACEBACK):
            return None
        self._awaited = None
        return b"%s cannot be executed: %s" % (node, line)

    def _new_lines(self) -> Iterator[bytes]:
        """Yields the complete lines written to the program's log since the last call, without colour codes.

        Of very many, only the last ones are read.
        """
        size = self._size()
        if size == self._offset:
            return
        start = max(min(self._offset, size), size - _CHUNK_BYTES)
        if start != self._offset:
            self._part = b""
        self._offset = size
        with suppress(OSError):
            *lines, self._part = (self._part + os.pread(self._descriptor, size - start, start)).split(b"\n")
            yield from (_COLOURS.sub(b"", line) for line in lines)

    def _size(self) -> int:
        return os.fstat(self._descriptor).st_size


FIRST_PAUSE_S = 0.5
"""Seconds before the first restart of a tool; doubles with each restart."""
MAX_PAUSE_S = 30.0
STEADY_LIFE_S = 60.0
"""Seconds of life after which a tool's restart has the first pause again."""
_NOT_STARTED = 127
_MOST_FIRST_LINE_BYTES = 256
"""Number of bytes of a script's first line that Linux reads."""
_RESTORED_SIGNALS = (signal.SIGINT, signal.SIGPIPE, signal.SIGXFSZ, signal.SIGCHLD, signal.SIGTERM)


Fork = Callable[[Callable[[], NoReturn]], int]
"""Function that forks a process which runs a function that never returns; returns its pid."""


class StartError(Exception):
    """Raised when a program cannot be started; the message says why."""


class Program:
    """A program of a run as a process, which can be started, watched and restarted.

    Args:
        plan: Plan of the program.
        environment: All environment variables of the program.
        output_dir: Output folder of the run; the program's logs are in `logs/` below it.
        confine: Called in the new process before the program is executed.
        clock: Monotonic clock in seconds, for the program's lifetime.
        fork: Function that forks the process, such as into a sandbox.

    Raises:
        OSError: The logs of the program cannot be created.
    """

    def __init__(
        self,
        plan: ProgramPlan,
        environment: Mapping[str, str],
        output_dir: Path,
        confine: Callable[[], None],
        clock: Callable[[], float] = time.monotonic,
        fork: Fork = fork_beside,
    ) -> None:
        self.plan = plan
        self._fork = fork
        self.pid: int | None = None
        """Process id until the program is reaped; None before its start, and between restarts."""
        self.ended: int | None = None
        """Pidfd that becomes readable when the program ends; None while it is not running."""
        self.logged_bytes: tuple[int, int] | None = None
        """Sizes of the logs of output and errors when the program was told to end; None: it was not yet."""
        self._environment = environment
        self._confine = confine
        self._clock = clock
        self._started_at = 0.0
        self._starts = 0
        self._ends = 0
        self._last_end = ""
        self._pause_s = FIRST_PAUSE_S
        stdout, stderr = program_logs(plan.name)
        folder = output_dir / LOG_FOLDER
        self.logs = (CappedLog(folder / stdout), CappedLog(folder / stderr))
        self._watches = [LaunchWatch(log.descriptor) for log in self.logs]

    @property
    def is_running(self) -> bool:
        """Whether the program was started and has not ended, as far as known."""
        return self.ended is not None

    def start(self) -> None:
        """Starts the run's program as a process of its own, with its logs.

        Raises:
            StartError: The program does not exist, or cannot be executed.
        """
        self._started_at = self._clock()
        self._starts += 1
        if self.plan.kind == "tool" and self.plan.exit_behavior == "RESTART":
            self._note(f"start {self._starts} of this tool")
        self.pid = spawn(self.plan.argv, self.plan.folder, self._environment, self.logs, self._confine, self._fork)
        self.ended = os.pidfd_open(self.pid)

    def launch_failure(self) -> str | None:
        """Returns a failure that a ROS launch program has logged since the last call; `None` if there is none."""
        return next((said for watch in self._watches if (said := watch.look()) is not None), None)

    def see_end(self) -> int:
        """Returns the wait status of the ended program, without reaping it.

        Until it is reaped, no other process can get its id, so that its group can be killed safely.
        """
        assert self.pid is not None
        assert self.ended is not None
        status = _peek(self.pid)
        os.close(self.ended)
        self.ended = None
        return status

    def terminate(self) -> None:
        """Asks the program and its process group to end (SIGTERM); does nothing if it does not run."""
        if self.pid is not None:
            if self.logged_bytes is None:
                output, errors = (os.fstat(log.descriptor).st_size for log in self.logs)
                self.logged_bytes = output, errors
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGTERM)

    def clear_away(self) -> None:
        """Kills the remaining processes of the program's process group, and reaps the program."""
        if self.pid is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
            self.pid = None

    def pause(self, how: str) -> float:
        """Returns how long to wait before the program's restart, in seconds, and notes that in its log.

        Each pause is twice as long as the one before, up to a limit, until the program has run for some time.

        Args:
            how: Description of the program's end.
        """
        self._ends, self._last_end = self._ends + 1, how
        if self._clock() - self._started_at >= STEADY_LIFE_S:
            self._pause_s = FIRST_PAUSE_S
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, MAX_PAUSE_S)
        self._note(f"it {how}; it is started again in {pause_s:g} s")
        return pause_s

    @property
    def restarts(self) -> ToolEnds | None:
        """Number of the program's restarts, and reason of the last one; `None` if it was never restarted."""
        if not self._ends:
            return None
        plan = self.plan
        name = plan.name.removeprefix(f"{plan.role}-")
        return ToolEnds(role=plan.role, name=name, ends=self._ends, last_end=self._last_end)

    def clean_up(self) -> int | None:
        """Starts the program's cleanup command, such as removing a container, and returns the command's process id.

        Returns:
            The process id; `None` if the program has no cleanup command or never started, or the command cannot start.
        """
        if self.plan.cleanup_argv is None or self._starts == 0:
            return None
        try:
            return spawn(self.plan.cleanup_argv, Path("/"), self._environment, self.logs, self._confine)
        except StartError as error:
            self._note(f"cleaning up: {error}")
            return None

    def _note(self, text: str) -> None:
        self.logs[1].note(text)


def spawn(
    argv: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    logs: tuple[CappedLog, CappedLog],
    confine: Callable[[], None],
    fork: Fork = fork_beside,
) -> int:
    """Starts an executable in its own session with only its logs open; it dies with this process.

    Args:
        argv: Program, searched in the environment's `PATH`, and its arguments.
        folder: Working directory.
        environment: All environment variables.
        logs: Logs of standard output and error; standard input is empty.
        confine: Called in the new process before the program is executed.
        fork: Function that forks the process.

    Returns:
        Process id of the new process.

    Raises:
        StartError: The executable cannot be started.
    """
    failed, tell = os.pipe()

    def become() -> NoReturn:
        try:
            nothing = os.open(os.devnull, os.O_RDONLY)
            for descriptor, target in ((nothing, 0), (logs[0].descriptor, 1), (logs[1].descriptor, 2)):
                os.dup2(descriptor, target)
            os.closerange(3, tell)
            os.closerange(tell + 1, os.sysconf("SC_OPEN_MAX"))
            for number in _RESTORED_SIGNALS:  # what is ignored stays ignored in programs
                signal.signal(number, signal.SIG_DFL)
            confine()
            os.chdir(folder)
            os.execvpe(argv[0], list(argv), dict(environment))  # noqa: S606 - no shell is meant
        except BaseException as error:
            os.write(tell, _why_not(error, argv[0], folder).encode())
        finally:
            os._exit(_NOT_STARTED)

    try:
        pid = fork(become)
    except OSError:
        os.close(failed)
        raise
    finally:
        os.close(tell)
    with os.fdopen(failed, "rb") as reader:
        problem = reader.read()  # ends when the program has taken over, or failed to
    if problem:
        os.waitpid(pid, 0)
        raise StartError(problem.decode(errors="replace"))
    return pid


def _why_not(error: BaseException, program: str, folder: Path) -> str:
    if isinstance(error, OSError) and error.filename == str(folder):  # what confines the program fails otherwise
        return f"its working directory {folder} cannot be entered: {error.strerror}"
    if isinstance(error, FileNotFoundError) and Path(program).is_file():
        return f"{program} is there, but not the interpreter that its first line names{_interpreter(Path(program))}"
    if isinstance(error, FileNotFoundError):
        return f"program not found: {program}"
    if isinstance(error, PermissionError):
        return f"{program} is not executable: {error.strerror}"
    return f"{program} cannot be executed: {error}"


def _interpreter(script: Path) -> str:
    """Returns `, /usr/bin/python3`: the program that the first line of a script names; empty: it has none."""
    with suppress(OSError), script.open("rb") as file:
        line = file.readline(_MOST_FIRST_LINE_BYTES).decode(errors="replace")
        if line.startswith("#!") and (words := line[2:].split()):
            return f", {words[0]}"
    return ""


def _peek(pid: int) -> int:
    """Returns the wait status of a child that has ended, without reaping it."""
    info = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    assert info is not None
    return info.si_status << 8 if info.si_code == os.CLD_EXITED else info.si_status
