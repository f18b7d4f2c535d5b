"""Performing a stored job exactly once at a time, whoever tries.

Every job operation has a perform half that carries a stored job to its end. Several may try: the
flow that made the job, a worker that was handed it, someone who resumes after a crash. A lease in
the catalog lets one of them work; the others wait for the end, or take over when the lease of a
dead one runs out.
"""

import os
import socket
import threading
import time
import uuid
from collections.abc import Callable

from ..schemas.lifecycles import is_terminal
from .catalog import Resource
from .service import Service

LEASE_S = 30.0
_RENEW_S = 5.0
_WAIT_S = 0.5


def perform_once(arn: str, kind: str, service: Service, work: Callable[[Resource], None]) -> None:
    """Runs `work` on a job unless it has ended, holding its lease meanwhile.

    Args:
      arn: the job.
      kind: the resource kind it has to be.
      service: where it is stored.
      work: carries the job on from wherever it stands to a terminal state.

    Raises:
      ResourceNotFoundException: there is no such job.
    """
    owner = f"{socket.gethostname()}:{os.getpid()}:{uuid.uuid4().hex[:8]}"
    while True:
        resource = service.catalog.get(arn, kind=kind)
        if is_terminal(kind, resource.status):
            return
        if service.catalog.claim(arn, owner, LEASE_S):
            break
        time.sleep(_WAIT_S)
    done = threading.Event()
    renewer = threading.Thread(target=_renew, args=(arn, owner, service, done), daemon=True)
    renewer.start()
    try:
        work(service.catalog.get(arn, kind=kind))
    finally:
        done.set()
        renewer.join()
        service.catalog.release(arn, owner)


def _renew(arn: str, owner: str, service: Service, done: threading.Event) -> None:
    while not done.wait(_RENEW_S):
        service.catalog.renew(arn, owner, LEASE_S)
