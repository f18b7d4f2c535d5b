"""The supervisor of one run: a small process between the launcher and the run.

It runs no application code, so nothing an application does (a crash, a C call that never returns, an
ignored signal, a fork bomb) keeps it from doing its work:

- it starts the run's process, where the run has an episode, and its programs;
- it kills all of them and everything they started when it is told to, when the run ends, and when the
  launcher's process disappears, however that happens (the channel between them closes);
- it adopts processes whose parents died, so that grandchildren which left the process group are found;
- it looks at what they use and how long their logs are;
- it reports how the run ended and in which phase.
"""

import json
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection

from ...schemas.errors import LaunchError
from .processes import adopt_orphans, come_first, die_with_parent, kill_children
from .progress import Progress
from .run_request import RunRequest
from .supervision import Supervision

RunChild = Callable[[RunRequest, Progress], int]
"""Carries out the run described by a request; returns the exit code."""


def supervise(channel: Connection, run_child: RunChild) -> None:
    """Starts one run, watches it, leaves none of its processes behind.

    Messages to the launcher are JSON objects: `{"event": "started"}`, or `{"event": "refused", "code":
    str, "reason": str}`; under `Continue` perhaps `{"event": "crashed", "exit": object}`; at last
    `{"event": "exited", "exit": object}`, each object an `outcomes.Exit`. Messages from the launcher:
    `{"stop": reason}` asks the run to finish (SIGTERM), `{"kill": true}` ends it.

    Args:
        channel: Connection to the launcher; the first message is a `RunRequest`.
        run_child: What the run's process does.
    """
    os.setsid()
    adopt_orphans()
    come_first()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    try:
        request = RunRequest.model_validate_json(channel.recv_bytes())
    except EOFError:
        return
    progress = Progress()

    def fork_run(confine: Callable[[], None]) -> int:
        supervisor = os.getpid()
        pid = os.fork()
        if pid == 0:
            channel.close()
            _become_run(supervisor, request, run_child, progress, confine)
        return pid

    def tell(message: dict[str, object]) -> None:
        with suppress(OSError):  # nobody may be left to be told
            channel.send_bytes(json.dumps(message).encode())

    supervision = Supervision(channel, request, progress, fork_run, tell)
    try:
        supervision.prepare()
    except (LaunchError, OSError) as error:
        kill_children()
        code = error.failure_code if isinstance(error, LaunchError) else "InternalServiceError"
        tell({"event": "refused", "code": code, "reason": str(error)})
        return
    tell({"event": "started"})
    supervision.start()
    supervision.until_end()
    tell({"event": "exited", "exit": supervision.finish().to_message()})


def _become_run(
    supervisor: int, request: RunRequest, run_child: RunChild, progress: Progress, confine: Callable[[], None]
) -> None:
    """Turns a fork into the run's process; never returns."""
    code = 70  # EX_SOFTWARE: the runtime itself failed
    try:
        os.setsid()
        # The supervisor itself may be killed too, for want of memory for example.
        die_with_parent()
        if os.getppid() == supervisor:
            confine()
            code = run_child(request.for_run_process(), progress)
    finally:
        # Not sys.exit: this fork must not run the clean-up of the process it was copied from.
        os._exit(code)
