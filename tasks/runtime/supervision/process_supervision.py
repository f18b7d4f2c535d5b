"""Supervision of the processes of one run: detects their ends, and restarts, reports or ends the run."""

import heapq
import itertools
import json
import os
import resource
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import Any

from ....schemas.runs.programs import RunStop, ToolEnds
from ....schemas.runs.trials import TrialRecordings
from ..episode.progress import AGENT_GONE, Phase, Progress
from ..limits.disk_use import disk_meter
from ..limits.limits import Excess, Meter, apply_limits
from ..limits.logs import LOG_FOLDER, STDERR_LOG, STDOUT_LOG, CappedLog
from ..limits.processes import descendants_of, kill_children
from ..process.run_request import RunRequest, rules_of_run
from ..sandbox.box import Box, fork_beside
from ..sandbox.kernel import confine
from .ports import are_listened_on, fork_forwarder, open_ports
from .programs import Program, StartError
from .run_outcomes import Crash, Exit, how_it_ended
from .run_requests import program_environment

END_GRACE_S = 1.0
"""Seconds that processes get to end once the run has ended."""
LAST_WORD_S = 1.0
"""Seconds after an episode's end in which the end of its robot program still counts as the cause."""
AGENT_GONE_S = 0.5
"""Seconds in which an episode detects by itself that its robot program has ended."""
CLEAN_UP_TIMEOUT_S = 6.0
TELL_TRIALS_EVERY_S = 2.0
"""Seconds between two messages about the number of finished trials."""
_CLEAN_UP_POLL_S = 0.02
PORTS_PATIENCE_S = 10.0
"""Seconds for applications to listen on forwarded ports; after that the job counts as running anyway."""
_PORTS_POLL_S = 0.1


class Supervision:
    """Supervises the processes of one run, from the first to the last.

    Args:
        channel: Connection to the launcher.
        request: Request of the run.
        progress: Memory shared with the run's process.
        begin_run: Function that lets the run's process begin; returns its pid.
        tell: Function that sends a message to the launcher.
        box: Sandbox of the run's processes, if they have one.
    """

    def __init__(
        self,
        channel: Connection,
        request: RunRequest,
        progress: Progress,
        begin_run: Callable[[], int],
        tell: Callable[[dict[str, Any]], None],
        box: Box | None = None,
    ) -> None:
        self._box = box
        self._channel = channel
        self._request = request
        self._plan = request.plan
        self._progress = progress
        self._begin_run = begin_run
        self._tell = tell
        self._run_pid: int | None = None
        self._run_ended: int | None = None
        """Pidfd of the run's process while it lives."""
        self._run_status: int | None = None
        self._programs: list[Program] = []
        self._logs: list[CappedLog] = []
        self._others = frozenset({box.keeper}) if box else frozenset[int]()
        """Ids of processes below this one that do not belong to the run."""
        self._meter = Meter(self._plan.compute, self._others)
        self._disk = disk_meter(self._plan, _pids_of_run)
        self._disk_writer: int | None = None
        """Session of the processes that had written most when the run's folders exceeded their limit."""
        self._next_look_s = 0.0
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._is_over = False
        self._is_stopping = False
        self._was_asked = False
        """Whether the run was told to end."""
        self._is_stopped = False
        """Whether the launcher stopped the run."""
        self._is_completed = False
        """Whether an application ended with exit code 0, in a run without an episode."""
        self._forwarder = os.getpid()
        """Id of a process in the applications' network."""
        self._crash: Crash | None = None
        self._has_crashed = False
        """Whether a program crashed and the run continues nevertheless."""
        self._told_trials: tuple[int, TrialRecordings | None] = (0, None)
        self._next_tell_s = 0.0

    # Beginning

    def prepare(self) -> None:
        """Opens the run's forwarded ports, starts the processes that forward them, and creates the programs' logs.

        No program is started yet.

        Raises:
            LaunchError: A port is taken.
            OSError: The logs cannot be made.
        """
        plan = self._plan
        ports = open_ports(plan.ports, is_shared=self._request.box.network == "full")
        if self._box and self._box.doors:
            self._others |= {fork_forwarder(self._box.doors)}
        if ports:
            self._forwarder = fork_forwarder(ports, self._box.join_network if self._box else lambda: None)
            self._others |= {self._forwarder}
        self._meter = Meter(plan.compute, self._others)
        folder = plan.output_dir / LOG_FOLDER
        folder.mkdir(parents=True, exist_ok=True)
        if plan.has_episode:
            self._logs = [CappedLog(folder / STDOUT_LOG), CappedLog(folder / STDERR_LOG)]
        in_containers = {program.role for program in plan.programs if program.image_id is not None}
        for program in plan.programs:
            environment = program_environment(self._request, program)
            if program.cleanup_argv is not None:  # a container, whose engine confines it
                # Programs have limits of their own, and may be about to set a higher one.
                limits = plan.compute.model_copy(update={"processes": None})
                confined, fork = partial(apply_limits, limits, self._request.cores), fork_beside
            elif program.role in in_containers:  # a tool, which the engine starts there
                confined, fork = partial(apply_limits, plan.compute, self._request.cores), fork_beside
            else:
                confined = partial(_confine_in_box, self._request)
                fork = self._box.fork if self._box else fork_beside
            self._programs.append(Program(program, environment, plan.output_dir, confined, fork=fork))
            self._logs += self._programs[-1].logs

    def start(self) -> None:
        """Starts the simulation process and the programs of the run, and watches the forwarded ports."""
        if self._plan.has_episode:
            self._run_pid = self._begin_run()
            self._run_ended = os.pidfd_open(self._run_pid)
        for program in self._programs:
            self._start(program)
        if self._plan.ports:
            self._look_at_ports(time.monotonic() + PORTS_PATIENCE_S)

    def _look_at_ports(self, until_s: float) -> None:
        """Reports to the launcher, once, that applications listen on the forwarded ports, or did not do so in time."""
        if time.monotonic() >= until_s or are_listened_on(self._plan.ports, self._forwarder):
            self._tell({"event": "answering"})
        elif not self._is_stopping:
            self._after(_PORTS_POLL_S, partial(self._look_at_ports, until_s))

    def _start(self, program: Program) -> None:
        if self._is_stopping:
            return
        try:
            program.start()
        except (StartError, OSError) as error:
            if _restarts(program):
                self._after(program.pause(f"could not be started: {error}"), partial(self._start, program))
            else:
                self._on_crash(_crash_of(program, f"could not be started: {error}"))

    # Watching

    def until_end(self) -> None:
        """Supervises the run's processes until the run has ended and its processes had time to finish.

        Obeys the launcher, handles ended processes, and looks at the use of resources meanwhile.
        """
        while not self._is_over:
            now = time.monotonic()
            due = min([self._next_look_s, *(timer[0] for timer in self._timers[:1])])
            ready = wait([self._channel, *self._pidfds()], max(0.0, due - now))
            if self._channel in ready:
                self._obey()
            self._look_who_ended(ready)
            while self._timers and self._timers[0][0] <= time.monotonic():
                heapq.heappop(self._timers)[2]()
            self._look_at_use()
            if self._is_stopping and not self._pidfds():
                return

    def _pidfds(self) -> list[int]:
        programs = [program.ended for program in self._programs if program.ended is not None]
        return programs if self._run_ended is None else [self._run_ended, *programs]

    def _obey(self) -> None:
        try:
            message = json.loads(self._channel.recv_bytes())
        except (EOFError, OSError):
            self._is_over = self._is_stopped = True
            return
        self._is_stopped = True
        if "stop" not in message:
            self._is_over = True
        else:
            self._is_stopping = True
            self._ask_to_end(message["stop"])

    def _look_who_ended(self, ready: list[Any]) -> None:
        if self._run_ended in ready:
            assert self._run_ended is not None
            os.close(self._run_ended)
            self._run_ended = None
            assert self._run_pid is not None
            _, self._run_status = os.waitpid(self._run_pid, 0)
            self._on_run_end()
        for program in self._programs:
            if program.ended in ready:
                self._on_program_end(program, program.see_end())

    def _look_at_use(self) -> None:
        if time.monotonic() < self._next_look_s:
            return
        excess = self._meter.look()
        self._look_at_launches()
        for log in self._logs:
            log.look()
        self._tell_trials()
        self._next_look_s = time.monotonic() + self._meter.interval_s
        if excess is not None:
            self._is_over = True  # at once, with any failure behaviour: its processes must not run any longer
            if not self._is_stopping:
                self._attribute(excess)
        elif self._disk_writer is None and self._disk.look():
            self._is_over = True  # files are measured and reported once no process writes to them
            self._disk_writer = self._meter.busiest_writer()

    def _look_at_launches(self) -> None:
        for program in self._programs:
            if program.plan.kind == "application" and program.is_running and not self._is_stopping:
                self._has_launch_failed(program)

    def _has_launch_failed(self, program: Program) -> bool:
        """Returns whether a program has logged that it could not launch its ROS nodes; reports that as its crash."""
        if (said := program.launch_failure()) is None:
            return False
        self._on_crash(_crash_of(program, f"failed in its launch: {said}"))
        return True

    def _tell_trials(self) -> None:
        """Reports to the launcher how many trials have finished and which one is recorded again, if that changed."""
        told = (self._progress.trials, self._progress.recordings)
        if told != self._told_trials and time.monotonic() >= self._next_tell_s:
            self._told_trials, self._next_tell_s = told, time.monotonic() + TELL_TRIALS_EVERY_S
            finished, recordings = told
            self._tell({"event": "trials", "finished": finished, "recordings": recordings and recordings.model_dump()})

    def _after(self, delay_s: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._timers, (time.monotonic() + delay_s, next(self._order), action))

    # What an end means

    def _on_run_end(self) -> None:
        exit_of_run = self._exit()
        if self._is_stopping:
            self._terminate_programs()
            return
        is_about_robot = exit_of_run.ended_by == "agent" or _failed_role(exit_of_run.report) == "robot"
        if is_about_robot and self._robot_program() is not None:
            # The program's end, which follows, may give a better reason.
            self._after(LAST_WORD_S, partial(self._conclude, exit_of_run))
        else:
            self._conclude(exit_of_run)

    def _conclude(self, exit_of_run: Exit) -> None:
        if self._is_stopping or self._has_crashed:
            return
        if exit_of_run.ended_by is None and self._plan.failure_behavior == "Continue":
            self._go_on(exit_of_run)
        else:
            self._end()

    def _on_program_end(self, program: Program, status: int) -> None:
        if self._is_stopping:
            return
        if _restarts(program):
            pause_s = program.pause(how_it_ended(status))
            program.clear_away()
            self._after(pause_s, partial(self._start, program))
        elif program.plan.kind == "application" and self._has_launch_failed(program):
            return
        elif program.plan.kind == "tool" or status != 0:
            if program.plan.kind == "tool" or not self._is_failing_by_itself():
                self._on_crash(_crash_of(program, how_it_ended(status)))
        elif self._run_pid is None:
            self._is_completed = not self._has_crashed
            if self._is_completed:
                self._end()
        elif self._run_status is not None:
            self._conclude(self._exit())
        else:
            self._after(AGENT_GONE_S, self._tell_run_that_agent_is_gone)

    def _is_failing_by_itself(self) -> bool:
        """Returns whether the run's process has reported a failure, which its robot program may have noticed first."""
        return self._run_status is None and _failed_role(self._progress.read_report()) == "simulation"

    def _on_crash(self, crash: Crash) -> None:
        if self._plan.failure_behavior == "Continue":
            if not self._has_crashed:
                self._go_on(Exit(None, None, self._progress.phase, {}, crash, self._tools()))
        else:
            self._crash = crash
            self._end()

    def _go_on(self, crashed: Exit) -> None:
        """Reports a crash after which the run continues until it is stopped."""
        self._has_crashed = True
        self._tell({"event": "crashed", "exit": crashed.to_message()})

    def _attribute(self, excess: Excess) -> None:
        what = f"used too much: {excess.text}"
        program = next((program for program in self._programs if program.pid == excess.session), None)
        if program is None and self._run_pid is None:
            program = self._programs[0]  # a process that left its session; there is but one application, mostly
        if program is not None:
            self._crash = _crash_of(program, what)
        else:
            self._crash = Crash(self._progress.phase.role or "simulation", what)

    def _robot_program(self) -> Program | None:
        applications = (program for program in self._programs if program.plan.kind == "application")
        return next((program for program in applications if program.plan.role == "robot" and program.is_running), None)

    # Ending

    def _end(self) -> None:
        """Asks the run's processes to end, as the run is over by itself, and kills them after some time."""
        if not self._is_stopping:
            self._is_stopping = True
            self._ask_to_end("canceled")
            self._after(END_GRACE_S / 2, lambda: self._ask_to_end("canceled"))
            self._after(END_GRACE_S, self._give_up)

    def _give_up(self) -> None:
        self._is_over = True

    def _ask_to_end(self, reason: str) -> None:
        # At the duration limit a robot program may still answer what it was asked, until it is asked to end again.
        is_first, self._was_asked = not self._was_asked, True
        self._progress.request_stop(reason)
        if not is_first and self._run_pid is not None and self._run_status is None:
            os.kill(self._run_pid, signal.SIGTERM)
        if reason != RunStop.DURATION_LIMIT or not is_first or self._run_ended is None:
            self._terminate_programs()

    def _terminate_programs(self) -> None:
        for program in self._programs:
            program.terminate()

    def _tell_run_that_agent_is_gone(self) -> None:
        if not self._is_stopping:
            self._progress.request_stop(AGENT_GONE)

    def finish(self) -> Exit:
        """Ends all processes of the run, cleans up after them, and closes its logs.

        Returns:
            End of the run as observed.
        """
        statuses = kill_children()
        if self._run_pid is not None and self._run_status is None:
            self._run_status = statuses.get(self._run_pid)
        self._clean_up()
        # A run that left more than it may has failed, even if it ended well.
        if not self._is_stopped and (found := self._disk.last_look()) is not None:
            self._attribute(Excess(found, self._disk_writer or 0))
        for log in self._logs:
            with suppress(OSError):
                log.close()
        sizes = {each.plan.name: each.logged_bytes for each in self._programs if each.logged_bytes is not None}
        return replace(self._exit(), cpu_time_s=_cpu_time_s(), logged_bytes=sizes)

    def _clean_up(self) -> None:
        left = {pid for program in self._programs if (pid := program.clean_up()) is not None}
        give_up_at = time.monotonic() + CLEAN_UP_TIMEOUT_S
        while left and time.monotonic() < give_up_at:
            left -= {pid for pid in left if os.waitpid(pid, os.WNOHANG)[0]}
            time.sleep(_CLEAN_UP_POLL_S if left else 0.0)
        kill_children()

    def _exit(self) -> Exit:
        tools = self._tools()
        if self._run_pid is None:
            ended_by = {"ended_by": "application"} if self._is_completed else {}
            return Exit(0 if self._is_completed else None, None, Phase.STARTING, ended_by, self._crash, tools)
        status, (steps, sim_time_s) = self._run_status, self._progress.where
        return Exit(
            exit_code=os.WEXITSTATUS(status) if status is not None and os.WIFEXITED(status) else None,
            signal=os.WTERMSIG(status) if status is not None and os.WIFSIGNALED(status) else None,
            phase=self._progress.phase,
            report=self._progress.read_report(),
            crash=self._crash,
            tools=tools,
            trial=self._trial(),
            steps=steps,
            sim_time_s=sim_time_s,
            judges=self._progress.judges,
        )

    def _trial(self) -> int | None:
        """Returns the number of the trial that the run's process is in, `None` without trials or after the last."""
        trials, finished = self._plan.trials, self._progress.trials
        return finished if trials is not None and finished < trials.count else None

    def _tools(self) -> list[ToolEnds]:
        return [restarts for program in self._programs if (restarts := program.restarts) is not None]


def _confine_in_box(request: RunRequest) -> None:
    apply_limits(request.plan.compute, request.cores)
    confine(request.box.level, rules_of_run(request))


def _pids_of_run() -> Iterator[int]:
    """Yields the ids of all processes below this one."""
    return (state.pid for state in descendants_of(os.getpid()))


def _cpu_time_s() -> float:
    """Returns the CPU time of all ended processes below this one, which are those of the run."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _failed_role(report: dict[str, Any]) -> str | None:
    return Phase(report["phase"]).role if "error" in report else None


def _restarts(program: Program) -> bool:
    return program.plan.kind == "tool" and program.plan.exit_behavior == "RESTART"


def _crash_of(program: Program, what: str) -> Crash:
    return Crash(program.plan.role, what, program.plan.name, is_tool=program.plan.kind == "tool")
