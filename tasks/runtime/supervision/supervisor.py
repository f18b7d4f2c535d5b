"""Supervisor of one run: a small process between the launcher and the run.

It runs no application code, so that nothing an application does (a crash, a C call that never returns, an ignored
signal, a fork bomb) can stop it:

- it starts the run's process, if the run has an episode, and its programs;
- it kills all of them and their descendants when it is told to, when the run ends, and when the
  launcher's process disappears, however that happens (the connection between them closes);
- it adopts processes whose parents died, so that descendants outside of the process group are found;
- it measures their resource use and the size of their logs;
- it reports how the run ended and in which phase.
"""

import json
import os
import signal
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection

from ....schemas.runs.programs import BoxLevel
from ....schemas.wire.errors import LaunchError
from ..episode.progress import Progress
from ..limits.processes import adopt_orphans, come_first, kill_children
from ..process.run_request import RunRequest, sights_of_run
from ..process.waiting_run import Rehearse, RunChild, WaitingRun
from ..sandbox.box import Box
from ..sandbox.local_callers import mark_run
from ..sandbox.visible_files import Sight
from ..states.provenance import note_run
from .process_supervision import Supervision


def stand_by(control: socket.socket, run_child: RunChild, rehearse: Rehearse, level: BoxLevel = "none") -> None:
    """Waits for a run's request, then supervises the run; main function of a supervisor process, which ends with it.

    The process gets a session of its own, and adopts orphans. If no run comes, the waiting run's process is ended.

    Args:
        control: Socket with one message that carries the connection to the run's launcher; closed, if no run will come.
        run_child: Function that runs the simulation in the run's process.
        rehearse: Function that warms up the waiting process.
        level: Sandbox level of runs that do not request a lower one.
    """
    os.setsid()
    adopt_orphans()
    come_first()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    progress = Progress()

    def wait(rehearse: Rehearse, close: Callable[[], None], level: BoxLevel) -> WaitingRun:
        box = Box() if level == "box" else None
        return WaitingRun(run_child, progress, close, rehearse, box)

    run = wait(rehearse, control.close, level)
    with control:
        _, descriptors, _, _ = socket.recv_fds(control, 1, 1)
    if not descriptors:
        run.dismiss()
        return
    channel = Connection(descriptors[0])
    try:
        message = channel.recv_bytes()
    except EOFError:
        run.dismiss()
        return
    request = RunRequest.model_validate_json(message)
    is_boxed = request.box.level == "box"
    sights = sights_of_run(request) if is_boxed else []
    try:
        for is_last in (False, False, True):
            if is_boxed == (run.box is not None) and _is_ready(run, sights, request, message, is_last=is_last):
                break
            run.dismiss()
            run = wait(lambda _: None, channel.close, request.box.level)
        else:
            raise OSError("the run's process was killed three times while it waited")
    except OSError as error:
        channel.send_bytes(_refusal(error))
        run.dismiss()
        return
    _supervise(channel, request, run, progress)


def _is_ready(run: WaitingRun, sights: Sequence[Sight], request: RunRequest, message: bytes, *, is_last: bool) -> bool:
    """Completes a waiting process's sandbox and sends it the run; false if it was killed or is outdated.

    Raises:
        OSError: The sandbox cannot be completed, and `is_last` is true.
    """
    if run.box is not None:
        try:
            run.box.furnish(sights, request.box.network, request.box.services)
        except OSError:
            if is_last:
                raise
            return False
    return run.tell(message)


def _refusal(error: LaunchError | OSError) -> bytes:
    code = error.failure_code if isinstance(error, LaunchError) else "InternalServiceError"
    return json.dumps({"event": "refused", "code": code, "reason": str(error)}).encode()


def _supervise(channel: Connection, request: RunRequest, run: WaitingRun, progress: Progress) -> None:
    """Starts one run, watches it, and leaves none of its processes behind.

    Messages to the launcher are JSON objects: `{"event": "started"}`, or `{"event": "refused", "code":
    str, "reason": str}`; `{"event": "answering"}` once forwarded ports answer; under `Continue` perhaps
    `{"event": "crashed", "exit": object}`; at last `{"event": "exited", "exit": object}`, each object a
    `run_outcomes.Exit`. Messages from the launcher:
    `{"stop": reason}` asks the run to finish (SIGTERM), `{"kill": true}` ends it.

    Args:
        channel: Connection to the launcher.
        request: Request of the run.
        run: Waiting process that becomes the run's process.
        progress: Memory that the run's process shares with this process.
    """
    if not request.plan.has_episode:
        run.dismiss(keep_box=True)

    def tell(message: dict[str, object]) -> None:
        with suppress(OSError):  # the launcher may be gone
            channel.send_bytes(json.dumps(message).encode())

    supervision = Supervision(channel, request, progress, run.begin, tell, run.box)
    try:
        mark_run(request.plan.output_dir.parent, request.plan.job_arn)
        supervision.prepare()
        if not request.plan.has_episode:
            with suppress(OSError):  # a full disk fails the run when its result is written
                note_run(request.for_run_process().plan)
    except (LaunchError, OSError) as error:
        kill_children()
        with suppress(OSError):  # the launcher may be gone
            channel.send_bytes(_refusal(error))
        return
    tell({"event": "started"})
    supervision.start()
    supervision.until_end()
    tell({"event": "exited", "exit": supervision.finish().to_message()})
