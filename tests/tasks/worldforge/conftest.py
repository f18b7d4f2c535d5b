"""Templates and worlds that the tests of WorldForge share."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.made_once import made_once

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.generator import generate_world

ROOMS = (
    ("Living Room", "Living", 26.0),
    ("Kitchen", "Kitchen", 14.0),
    ("Bedroom", "Bedroom", 16.0),
    ("Bath", "Bathroom", 10.0),
)

MakeBody = Callable[..., WorldTemplateBody]


@pytest.fixture(scope="session")
def make_body() -> MakeBody:
    """Makes a template of rooms given as (name, type, area), with an interior."""

    def make(
        rooms: tuple[tuple[str, str, float], ...] = ROOMS, height: float = 2.7, **interior: list[dict[str, Any]]
    ) -> WorldTemplateBody:
        floorplan = {
            "Footprint": {"DesiredAspectRatio": {"x": 4.0, "y": 3.0}},
            "Ceiling": {"Height": height},
            "Rooms": [
                {"Name": name, "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": 4.0, "y": 3.0}}}
                for name, kind, area in rooms
            ],
        }
        parts = {
            "Furniture": {"FurnitureArrangements": interior.get("furniture", [])},
            "Flooring": {"MaterialSets": interior.get("flooring", [])},
            "Walls": {"MaterialSets": interior.get("walls", [])},
        }
        return WorldTemplateBody.model_validate(
            {"Buildings": [{"Floors": [{"Floorplan": floorplan, "Interior": parts}]}]}
        )

    return make


@pytest.fixture(scope="session")
def flat(make_body: MakeBody) -> World:
    """A furnished flat of four rooms."""
    return generate_world(make_body(), 1, 2)


@pytest.fixture(scope="session")
def bundles(make_body: MakeBody, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Bundles of two flats with doors, and of two rooms without, by their names in archives; two share a floor plan."""
    doors = {"Name": "all", "TargetSet": "Target.All", "Door": {"InitialState": {"OpenPosition": {"Percent": 50}}}}
    wished: dict[str, Any] = make_body().model_dump(mode="json", exclude_none=True) | {"Version": "2"}
    wished["Buildings"][0]["Floors"][0]["Interior"]["Doorways"] = {"DoorwaySets": [doors]}
    dressed = parse_template_body(json.dumps(wished))
    wanted = {1: (dressed, 1, 2), 2: (dressed, 1, 3), 10: (make_body(ROOMS[:2]), 4, 5)}

    def make(folder: Path) -> None:
        folder.mkdir()
        for number, order in wanted.items():
            write_bundle(generate_world(*order, settle=False), folder / str(number))

    made = made_once(tmp_path_factory, "worldforge-bundles", make)
    return {f"generation_82856b0yq33y_world_{number}": made / str(number) for number in wanted}


@pytest.fixture(scope="session")
def export_zip(bundles: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The export of the bundles."""

    def make(folder: Path) -> None:
        folder.mkdir()
        write_export_zip(bundles, folder / "export.zip")
        with zipfile.ZipFile(folder / "export.zip") as archive:
            archive.extractall(folder)

    return made_once(tmp_path_factory, "worldforge-export", make) / "export.zip"


@pytest.fixture(scope="session")
def exported(export_zip: Path) -> Path:
    """The unpacked export of the bundles: its folder `aws_robomaker_worldforge_pkgs`."""
    return export_zip.parent / "aws_robomaker_worldforge_pkgs"
