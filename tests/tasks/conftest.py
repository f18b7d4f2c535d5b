from pathlib import Path

import pytest
from helpers.fake_engine import FakeEngine


@pytest.fixture
def fake(tmp_path: Path) -> FakeEngine:
    """A container engine with an image that does nothing for a minute."""
    engine = FakeEngine(tmp_path / "engine")
    engine.add_image("sleeper", command=["sleep", "60"])
    return engine
