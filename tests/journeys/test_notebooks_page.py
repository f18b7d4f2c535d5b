"""The page for notebooks: its cells, one after the other, in a process whose event loop runs, as notebooks have it."""

import asyncio
import re
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker import Run
from prefect_robomaker.tasks.service.service import Service

PAGE = REPOSITORY / "docs" / "notebooks.md"


@pytest.mark.deep
def test_the_cells_run_one_after_the_other(
    service: Service, prefect_server: str, known_worlds: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    cells = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)

    async def notebook() -> None:
        for number, cell in enumerate(cells, 1):
            exec(compile(cell, f"{PAGE.name}, cell {number}", "exec"), names)

    with service.activated():
        asyncio.run(notebook())

    night, latest = names["night"], names["latest"]
    assert isinstance(night, Run)
    assert isinstance(latest, Run)
    assert (night.passed, night.parameters, latest.id, len(night.rows)) == (True, {"worlds": 1}, night.id, 1)
    assert night.record is not None
    assert night.record.command == ["robomaker", "run", "two-rooms.yaml", "--set", "worlds=1", "--seed", "11"]
    told = capsys.readouterr()
    assert "worlds: Completed after" in told.err
    assert "Flow run" not in told.err, "Prefect's own lines are not shown beside ours"
    assert "did you mean 'name'?" in told.out
