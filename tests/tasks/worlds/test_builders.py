"""World builders: what happens when their processes die, hang, or are stopped."""

import os
import signal
import threading
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, read_world
from prefect_robomaker.tasks.worlds import builders as builders_module
from prefect_robomaker.tasks.worlds.builders import WorldBuilders

BODY = '{"Buildings": [{"Floors": [{"Interior": {"Furniture": {"FurnitureArrangements": []}}}]}]}'


def hurt(builders: WorldBuilders, number: int) -> None:
    """Sends a signal to the builder that was started last."""
    os.kill(builders._all[-1].pid, number)


@pytest.mark.deep
def test_builders_that_die_or_hang_are_replaced_and_a_folder_that_cannot_be_written_fails_its_world_only(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("in the way")
    with WorldBuilders(1, tmp_path / "log") as builders:
        hurt(builders, signal.SIGKILL)
        content = builders.build(BODY, 1, 2, tmp_path / "first")
        assert content == content_hash(tmp_path / "first")
        assert read_world(tmp_path / "first").floorplan_seed == 1
        with pytest.raises(WorldGenerationError, match="could not be written"):
            builders.build(BODY, 1, 2, tmp_path / "file" / "bundle")
        assert builders.build(BODY, 1, 2, tmp_path / "second") == content

        hurt(builders, signal.SIGSTOP)
        builders.most_s = 0.5
        with pytest.raises(WorldGenerationError, match=r"not built within 0\.5 s"):
            builders.build(BODY, 1, 2, tmp_path / "never")
        builders.most_s = 120.0
        assert builders.build(BODY, 1, 2, tmp_path / "third") == content


def test_stopped_builders_fail_at_once_and_start_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, answer = threading.Event(), builders_module._answer

    def noted(*order: Any) -> dict[str, str]:
        asked.set()
        return answer(*order)

    monkeypatch.setattr(builders_module, "_answer", noted)
    with WorldBuilders(1, tmp_path / "log") as builders:
        hurt(builders, signal.SIGSTOP)  # it builds nothing before it is stopped

        def stop() -> None:
            asked.wait()
            builders.stop()

        stopping = threading.Thread(target=stop)
        stopping.start()
        with pytest.raises(WorldGenerationError, match="ended with code -9"):
            builders.build(BODY, 1, 2, tmp_path / "never")
        stopping.join()
        with pytest.raises(WorldGenerationError, match="no more worlds"):
            builders.build(BODY, 1, 2, tmp_path / "never")
