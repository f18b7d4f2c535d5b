"""Fixtures that tests of commands share; `helpers.command_here` runs the command."""

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def spec(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a specification."""

    def write(text: str) -> Path:
        path = tmp_path / "spec.yaml"
        path.write_text(text)
        return path

    return write
