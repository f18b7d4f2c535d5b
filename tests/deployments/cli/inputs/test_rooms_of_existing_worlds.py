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
        "did you mean 'Bedroom'? Its rooms are Living room, Bedroom"
    )
    for world in ("my flat", flat):
        path.write_text(SPEC.replace("my flat", world))
        ended = robomaker(command, path)
        assert (ended.code, told in ended.err) == (2, True), ended.err
    path.write_text(SPEC.replace("Bedrom", "Bedroom"))
    assert robomaker(command, path).code == 0


JOB = """\
          maxJobDurationInSeconds: 60
          requirements:
            - {kind: goal, name: sleep, room: Bedrom}
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "${{ world }}"}]}
"""
LISTS = {
    "forEach": "        forEach: [WORLD]\n        as: world\n        value:\n",
    "axes": "        axes: {limit: {values: ['1', '2']}, world: {values: [WORLD]}}\n        value:\n"
    "          tags: {limit: '${{ limit }}'}\n",
    "include": "        axes: {world: {values: ['${{ list.worldSummaries[0].arn }}']}}\n"
    "        include: [{world: WORLD}]\n        value:\n",
}


@pytest.mark.parametrize("by", LISTS)
def test_a_room_is_looked_for_in_each_world_of_a_list_that_is_written_out(
    robomaker: Any, flat: str, tmp_path: Path, by: str
) -> None:
    path = tmp_path / "spec.yaml"
    head = (
        "version: 1\nname: rooms\nsteps:\n  list: {operation: ListWorlds}\n  drive:\n"
        "    operation: StartSimulationJobBatch\n    input:\n      createSimulationJobRequests:\n"
    )
    for world in ("my flat", flat):
        path.write_text(head + LISTS[by].replace("WORLD", world) + JOB)
        ended = robomaker("validate", path)
        assert ended.code == 2, ended.err
        assert (
            "createSimulationJobRequests.value.requirements[0].room: the world has no room 'Bedrom'; "
            "did you mean 'Bedroom'? Its rooms are Living room, Bedroom; the world is import-1/world-1" in ended.err
        ), ended.err
    path.write_text(path.read_text().replace("Bedrom", "Bedroom"))
    assert robomaker("validate", path).code == 0


def test_a_room_is_looked_for_though_the_specification_has_other_problems(
    robomaker: Any, flat: str, tmp_path: Path
) -> None:
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC.replace("maxJobDurationInSeconds: 60", "maxJobDurationInSeconds: 0").replace("my flat", flat))

    ended = robomaker("validate", path)

    assert "maxJobDurationInSeconds: is 0; " in ended.err
    assert "the world has no room 'Bedrom'" in ended.err
