"""Domains of ROS 2: each running job of this machine has one of its own."""

import hashlib
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager

_logger = logging.getLogger(__name__)

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
DOMAINS = range(1, 102)
"""All domains whose ports Linux leaves free (ROS 2's documentation, "The ROS_DOMAIN_ID"), without the default, 0."""


@contextmanager
def own_domain(job: str, holders: str = "robomaker-ros-domain") -> Iterator[int]:
    """Reserves a ROS 2 domain number that no other running job of this machine has; yields it.

    What holds it is the name of a socket. It belongs to the machine, whatever user runs jobs there, or to the container
    that they run in, as the ports of a domain do; and it is free again when its holder dies.

    Args:
        job: the job's ARN. The same job has the same domain again where it can, and jobs on two machines of a network,
            which hear each other too, most likely have different ones.
        holders: prefix of the names of sockets; only processes with the same prefix avoid each other's domains.
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
