"""Fixtures that tests of commands share; `helpers.command_here` runs the command."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from prefect_robomaker.deployments.cli import health


@pytest.fixture
def without_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the checks of `doctor` that start programs; `test_a_healthy_machine` has them all."""
    for name, subject in (("check_physics", "physics"), ("check_video", "video"), ("check_extras", "extras")):
        monkeypatch.setattr(health, name, partial(health.Finding, subject, "ok", "not looked at"))


@pytest.fixture
def spec(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a specification."""

    def write(text: str) -> Path:
        path = tmp_path / "spec.yaml"
        path.write_text(text)
        return path

    return write
