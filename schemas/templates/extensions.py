"""Members and values of template bodies that AWS did not allow (extensions), which a setting can forbid."""

from collections.abc import Iterator

from ..wire.common import counted
from ..worlds.world import SERVICE_ROOM_TYPES
from .body import FLOORPLAN_PATH, INTERIOR_PATH, SERVICE_LEAST_AREA_M2, WorldTemplateBody

SERVICE_MOST_ROOMS = 6
"""Maximum number of rooms of a template in AWS, and of sets of each kind in an interior."""
SERVICE_MOST_CONNECTIONS = 12


def body_extensions(body: WorldTemplateBody) -> Iterator[str]:
    """Finds everything in a template body that the service would have refused, one line each: path, value, its limit.

    Args:
        body: Body that `parse_template_body` accepts.
    """
    rooms = body.floorplan.Rooms
    if len(rooms) > SERVICE_MOST_ROOMS:
        yield f"{FLOORPLAN_PATH}.Rooms: {counted(len(rooms), 'room')}; the service took {SERVICE_MOST_ROOMS} at most"
    if len(body.floorplan.DesiredConnections) > SERVICE_MOST_CONNECTIONS:
        count = len(body.floorplan.DesiredConnections)
        yield f"{FLOORPLAN_PATH}.DesiredConnections: {count}; the service took {SERVICE_MOST_CONNECTIONS} at most"
    for index, room in enumerate(rooms):
        path = f"{FLOORPLAN_PATH}.Rooms[{index}]"
        if room.Type not in SERVICE_ROOM_TYPES:
            yield f"{path}.Type: {room.Type}; the service had {', '.join(SERVICE_ROOM_TYPES)}"
        if room.DesiredShape.Area < SERVICE_LEAST_AREA_M2:
            yield (
                f"{path}.DesiredShape.Area: {room.DesiredShape.Area:g} m2; the service took {SERVICE_LEAST_AREA_M2:g} "
                "or more"
            )
    interior = body.interior
    sets = {
        "Flooring.MaterialSets": interior.Flooring.MaterialSets,
        "Walls.MaterialSets": interior.Walls.MaterialSets,
        "Furniture.FurnitureArrangements": interior.Furniture.FurnitureArrangements,
    }
    for name, some in sets.items():
        if len(some) > SERVICE_MOST_ROOMS:
            yield f"{INTERIOR_PATH}.{name}: {len(some)} sets; the service took {SERVICE_MOST_ROOMS} at most"
    for index, arrangement in enumerate(body.interior.Furniture.FurnitureArrangements):
        if arrangement.LooseObjects is not None:
            yield (
                f"{INTERIOR_PATH}.Furniture.FurnitureArrangements[{index}].LooseObjects: "
                f"{arrangement.LooseObjects}; the service had no such member"
            )
