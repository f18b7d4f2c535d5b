"""The data home belongs to its user."""

import stat
from pathlib import Path

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_home_that_is_made_is_closed_to_others(tmp_path: Path) -> None:
    Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "new" / "home")}))
    assert mode(tmp_path / "new" / "home") == 0o700
    files = list((tmp_path / "new" / "home").glob("catalog.db*"))
    assert files
    assert {mode(path) for path in files} == {0o600}


def test_a_home_that_is_there_keeps_its_mode(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir(0o755)
    Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "home")}))
    assert mode(tmp_path / "home") == 0o755
