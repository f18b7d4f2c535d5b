"""Templates and worlds that the tests of WorldForge share."""

from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.schemas.world import World
from prefect_robomaker.schemas.world_template_body import WorldTemplateBody
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
