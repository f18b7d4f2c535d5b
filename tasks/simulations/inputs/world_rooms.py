"""The rooms of stored worlds; requests whose goals are in other rooms are refused."""

from dataclasses import dataclass
from functools import lru_cache

from pydantic import ValidationError

from ....schemas.documents.worlds import WorldDocument
from ....schemas.operations.simulation_jobs import SimulationJobRequestMembers
from ....schemas.runs.requested_requirements import rooms_asked, unknown_room
from ....schemas.wire.errors import InvalidParameterException, StorageError
from ....schemas.worlds.polygons import contains
from ....schemas.worlds.world import World
from ...catalog import Resource
from ...service.service import Service
from ...storage import ObjectStore

WORLD_FILE = "world.json"


@dataclass(frozen=True)
class Rooms:
    """The rooms of a world."""

    names: tuple[str, ...]
    start: str | None
    """Name of the room that the origin is in, where robots start; None: it is in none."""


def rooms_of_world(world: Resource, service: Service) -> Rooms | None:
    """The rooms of a world; `None` if they cannot be found out now.

    Args:
        world: the world.
        service: where its bundle is stored.
    """
    bundle = WorldDocument.of(world).bundle
    if not bundle:
        return None
    try:
        return _read(service.store, bundle.bucket, bundle.prefix)
    except (StorageError, ValidationError):  # the job worker finds out, and says so
        return None


def check_rooms(request: SimulationJobRequestMembers, world: Resource, service: Service, where: str = "") -> None:
    """Refuses a request whose goals ask for rooms that its world does not have.

    Args:
        request: for the job.
        world: the world it names.
        service: where that is stored.
        where: the path of `request` in a batch's request, with a dot at its end.

    Raises:
        InvalidParameterException: names the member, the room asked for and those that there are.
    """
    asked = rooms_asked(request)
    rooms = rooms_of_world(world, service) if asked else None
    if rooms is not None and (problem := unknown_room(asked, rooms.names)) is not None:
        raise InvalidParameterException(f"{where}{problem}")


@lru_cache(maxsize=256)  # a bundle's prefix is the hash of its content
def _read(store: ObjectStore, bucket: str, prefix: str) -> Rooms:
    rooms = World.model_validate_json(store.get_bytes(bucket, f"{prefix}/{WORLD_FILE}")).floorplan.rooms
    start = next((room.name for room in rooms if contains(room.polygon, 0.0, 0.0)), None)
    return Rooms(tuple(room.name for room in rooms), start)
