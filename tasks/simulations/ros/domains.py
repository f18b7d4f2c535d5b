"""Domains of ROS 2: programs of one job find each other there, and not those of other jobs of the machine."""

import hashlib
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
DOMAINS = range(1, 102)
"""All domains whose ports Linux leaves free (ROS 2's documentation, "The ROS_DOMAIN_ID"), without the default, 0."""

_logger = logging.getLogger(__name__)


@contextmanager
def own_domain(job: str, holders: str = "robomaker-ros-domain") -> Iterator[int]:
    """Holds a domain that no other running job of this machine has; yields its number.

    What holds it is the name of a socket. It belongs to the machine, whatever user runs jobs there, or to the container
    that they run in, as the ports of a domain do; and it is free again when its holder dies.

    Args:
        job: the job's ARN. The same job has the same domain again where it can, and jobs on two machines of a network,
            which hear each other too, most likely have different ones.
        holders: what names of sockets begin with; only those with the same beginning keep out of each other's way.
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
