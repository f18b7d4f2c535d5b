"""Ports that something else binds in a moment."""

import random
import socket

_CLIENTS_FROM = 32_768
"""The first port that Linux gives to clients by itself: any connection of any test could be given one of those."""


def free_port() -> int:
    """A port of 127.0.0.1 that nothing listens at."""
    while True:
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", random.SystemRandom().randrange(20_000, _CLIENTS_FROM)))
            except OSError:
                continue
            return int(probe.getsockname()[1])
