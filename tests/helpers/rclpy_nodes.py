"""Nodes of a real ROS 2, `rclpy` with Fast DDS, as processes of an environment of their own.

Its packages replace the libraries of the process that imports them, so that no test imports them itself.
"""

import os
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from helpers.paths import REPOSITORY
from helpers.required_programs import missing

VARIABLE = "ROBOMAKER_TESTS_RCLPY"
"""Names the Python of such an environment."""
_MADE = REPOSITORY / ".tools" / "ros-jazzy" / "bin" / "python"
"""The one that `.ci/run` makes."""
_REACH = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}


def rclpy_python() -> Path:
    """The Python that has `rclpy`; where there is none the test is skipped, or fails if it has to be there."""
    named = os.environ.get(VARIABLE)
    python = Path(named) if named else _MADE
    if not python.exists():
        missing("rclpy", f"no Python with rclpy: {VARIABLE} names none, and {_MADE} is not there")
    return python


@contextmanager
def node(
    script: Path | str, domain: int, variables: Mapping[str, str] | None = None
) -> Iterator["subprocess.Popen[str]"]:
    """Runs a node until the block is left.

    Args:
        script: Its file, or its text.
        domain: Domain of ROS 2.
        variables: Variables besides those of this process.
    """
    arguments = [str(script)] if isinstance(script, Path) else ["-c", script]
    process = subprocess.Popen(
        [str(rclpy_python()), *arguments],
        env={**os.environ, **_REACH, **(variables or {}), "ROS_DOMAIN_ID": str(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()
