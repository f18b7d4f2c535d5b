"""Processes that see nothing of what other machines of a test have written: in mount namespaces of their own."""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

_UNSHARE = ["unshare", *(["--map-root-user"] if os.geteuid() else []), "--mount", "--propagation", "private"]
_SCRIPT = 'mount -t tmpfs -o size="$3" none "$1" && mkdir -p "$2" && shift 3 && exec "$@"'


def _allowed() -> bool:
    try:
        return subprocess.run([*_UNSHARE, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


NEEDS_NAMESPACES = pytest.mark.skipif(not _allowed(), reason="this user may make no mount namespaces")
"""Marks tests whose machines are apart."""


def apart(command: Sequence[str], hidden: Path, home: Path, *, size_mb: int | None = None) -> list[str]:
    """The words that run a command where a folder is empty but for a new one.

    Args:
        command: What is run.
        hidden: What it does not see, and nobody else sees what it writes there.
        home: The folder that is there for it, `hidden` or below.
        size_mb: How much it may write there; absent: half of the memory.
    """
    size = "50%" if size_mb is None else f"{size_mb}m"
    return [*_UNSHARE, "sh", "-c", _SCRIPT, "sh", str(hidden), str(home), size, *command]
