"""Rooms that requirements name in a world that exists: `validate` and `plan` tell what a run would refuse."""

from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.reports.names import NAME_LABEL
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.inspection import preflight
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import Rooms

SPEC = """\
version: 1
name: rooms
steps:
  drive:
    operation: CreateSimulationJob
    input:
      maxJobDurationInSeconds: 60
      iamRole: arn:aws:iam::000000000000:role/local
      requirements:
        - {kind: goal, name: sleep, room: Bedrom}
      simulationApplications:
        - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: my flat}]}
"""


@pytest.fixture
def flat(service: Service, monkeypatch: pytest.MonkeyPatch) -> str:
    """Adds the world `my flat`, of two rooms; returns its ARN."""
    world = Resource.new(
        arn=service.arn("world", "import-1/world-1"),
        kind="world",
        id="import-1/world-1",
        status="Active",
        labels={NAME_LABEL: ["my flat"]},
        document={"name": "my flat"},
    )
    monkeypatch.setattr(preflight, "rooms_of_world", lambda *_: Rooms(("Living room", "Bedroom"), None))
    return service.catalog.create(world, token=None).arn


@pytest.mark.parametrize("command", ["validate", "plan"])
def test_a_room_that_an_existing_world_has_not_is_told_with_its_place(
    robomaker: Any, flat: str, tmp_path: Path, command: str
) -> None:
    path = tmp_path / "spec.yaml"
    told = (
        f"{path}:10:43: steps.drive.input.requirements[0].room: the world has no room 'Bedrom'; "
        "its rooms are Living room, Bedroom"
    )
    for world in ("my flat", flat):
        path.write_text(SPEC.replace("my flat", world))
        ended = robomaker(command, path)
        assert (ended.code, told in ended.err) == (2, True), ended.err
    path.write_text(SPEC.replace("Bedrom", "Bedroom"))
    assert robomaker(command, path).code == 0
