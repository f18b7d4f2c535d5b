"""A real ROS 2, `rclpy` with Fast DDS, in an environment of its own.

Its packages replace the libraries of the process that imports them, so that no test imports them itself.
"""

from pathlib import Path

import pytest

from helpers.client_environments import rclpy_environment


@pytest.fixture
def rclpy(pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The Python of an environment with rclpy, which jobs may read; the test is skipped where it cannot be had."""
    python = rclpy_environment(pytestconfig) / "python"
    monkeypatch.setenv("ROBOMAKER_SANDBOX_SHOW", str(python.parents[1]))
    return python
