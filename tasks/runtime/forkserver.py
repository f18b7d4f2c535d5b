"""The warm process that runs are forked from.

It has imported what every run needs and then only forks, so a run starts in milliseconds. It is a
program of its own rather than Python's `multiprocessing` fork server, which is shared by everything in
a process, imports the caller's `__main__` again in each child and hands down the caller's standard
output. Here nothing is inherited but a cleaned environment.

Started as `python -P -m prefect_robomaker.tasks.runtime.forkserver FD`. The socket FD carries one
message to the launcher (`ready`, or why not), then one message per run from the launcher, with the
run's own connection attached. When the launcher's end closes, the process ends.
"""

import gc
import importlib
import os
import signal
import socket
import sys
import traceback
from multiprocessing.connection import Connection

READY = b"ready"
_MODULES = (
    "numpy",
    "mujoco",
    "dm_control.mujoco",
    "dm_control.rl.control",
    "mcap.writer",
    "zstandard",
    "prefect_robomaker.tasks.runtime.child",
    "prefect_robomaker.tasks.runtime.applications.indoor_navigation",
    "prefect_robomaker.tasks.runtime.applications.scout",
)


def main() -> None:
    """Imports, reports, then forks a supervisor per message."""
    control = socket.socket(fileno=int(sys.argv[1]))
    try:
        for name in _MODULES:
            importlib.import_module(name)
    except Exception:
        control.send(traceback.format_exc().encode()[-4000:])
        return
    from .child import run_child
    from .supervisor import supervise

    # Supervisors report to the launcher; nobody here waits for them.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.collect()
    gc.freeze()  # keeps the collector from touching, and so copying, the shared pages in each run
    control.send(READY)
    while True:
        message, descriptors, _, _ = socket.recv_fds(control, 1, 1)
        if not message:
            return
        (descriptor,) = descriptors
        if os.fork() == 0:
            try:
                control.close()
                supervise(Connection(descriptor), run_child)
            finally:
                os._exit(0)
        os.close(descriptor)


if __name__ == "__main__":
    main()
