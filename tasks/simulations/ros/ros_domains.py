"""Domains of ROS 2: each running job of this machine has one of its own."""

import hashlib
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager

_logger = logging.getLogger(__name__)

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
DOMAINS = range(1, 102)
"""ROS 2 domain ids whose ports Linux leaves free (ROS 2's documentation, "The ROS_DOMAIN_ID"), without the default, 0.
"""


@contextmanager
def own_domain(job: str, holders: str = "robomaker-ros-domain") -> Iterator[int]:
    """Reserves, inside the `with` block, a ROS 2 domain id that no other running job of this machine has; yields it.

    The name of an abstract socket holds it. Such names belong to the machine, whichever user runs jobs, or to the
    container in which they run, as the ports of a domain do; and they are free again when the process dies. If none is
    free, one that another job has is yielded, and a warning is logged.

    Args:
        job: ARN of the job. The same job gets the same domain again if possible; jobs on two machines of a network,
            which hear each other, too, most likely get different ones.
        holders: Prefix of the sockets' names; only processes with the same prefix avoid each other's domains.
    """
    first = int.from_bytes(hashlib.sha256(job.encode()).digest()[:8], "big") % len(DOMAINS)
    for domain in (*DOMAINS[first:], *DOMAINS[:first]):
        with socket.socket(socket.AF_UNIX) as holder:
            try:
                holder.bind(f"\0{holders}-{domain}")
            except OSError:
                continue
            yield domain
            return
    _logger.warning("%s gets ROS 2 domain %d, which another job has too: none is free", job, DOMAINS[first])
    yield DOMAINS[first]
