"""Worlds of tests that are not about how worlds are built: each is built once in a test run."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from helpers.made_once import made_once
from prefect_robomaker.schemas.wire.arns import world_id
from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worlds.builders import WorldBuilders
from prefect_robomaker.tasks.worlds.generation import generate_world

_CONTENT = "content"


@pytest.fixture
def known_worlds(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Generation jobs of this process start no builders: a world of known body and seeds is copied.

    Starting the builders takes most of the time of a job of a few worlds. What is built stays the product's: the first
    job that wants a world has it built.
    """
    enter, build, leave = WorldBuilders.__enter__, WorldBuilders.build, WorldBuilders.__exit__

    def build_anew(place: Path, order: tuple[str, int, int]) -> None:
        place.mkdir()
        builders = WorldBuilders(1, place / "builders.log")
        enter(builders)
        try:
            (place / _CONTENT).write_text(build(builders, *order, place / "bundle"))
        finally:
            leave(builders, None, None, None)

    def copy(self: WorldBuilders, body: str, floorplan_seed: int, interior_seed: int, folder: Path) -> str:
        if self._stopped:
            raise WorldGenerationError("no more worlds are wanted")
        order = (body, floorplan_seed, interior_seed)
        name = f"world-{hashlib.sha256(json.dumps(order).encode()).hexdigest()[:16]}"
        known = made_once(tmp_path_factory, name, lambda place: build_anew(place, order))
        shutil.copytree(known / "bundle", folder)
        return (known / _CONTENT).read_text()

    def start_none(self: WorldBuilders) -> WorldBuilders:
        return self

    def end_none(self: WorldBuilders, *error: Any) -> None:
        del error
        self.stop()

    monkeypatch.setattr(WorldBuilders, "__enter__", start_none)
    monkeypatch.setattr(WorldBuilders, "__exit__", end_none)
    monkeypatch.setattr(WorldBuilders, "build", copy)


def make_worlds(service: Service, job: str, count: int, folder: Path) -> None:
    """Makes the first worlds of a stored generation job in this process, without a flow run; the job stays running."""
    stored = service.catalog.transition(job, "start")
    with WorldBuilders(1, folder / "builders.log") as builders:
        for index in range(count):
            arn = service.arn("world", world_id(stored.id, index + 1))
            assert generate_world(service, stored, index, arn, builders, lambda _, step: step()) is None
