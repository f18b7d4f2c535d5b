"""Makes the description of a world for other programs (`world_description.json`)."""

from ....schemas.worlds.description import (
    DescribedDoor,
    DescribedFurniture,
    DescribedPassage,
    DescribedRoom,
    Opening,
    Pose,
    Position,
    Proofs,
    Seeds,
    Size,
    WorldDescription,
)
from ....schemas.worlds.world import Door, Furniture, Passage, Room, World
from ..floorplans.plan_signature import signature_of
from ..proofs.guarantees import violations


def describe(world: World) -> WorldDescription:
    """Makes the description of a world (rooms, doors, furniture) for other programs."""
    plan = world.floorplan
    return WorldDescription(
        templateVersion=world.template_version,
        generatorVersion=world.generator_version,
        seeds=Seeds(floorplan=world.floorplan_seed, interior=world.interior_seed),
        ceilingHeight=plan.ceiling_height_m,
        footprint=plan.footprint,
        plan=None if world.source else signature_of(plan).key,
        rooms=[_room(room) for room in plan.rooms],
        passages=[_passage(passage) for passage in plan.passages],
        doors=[_door(passage.door, passage) for passage in plan.passages if passage.door],
        furniture=[_furniture(item) for item in world.furniture],
        source=world.source,
        variation=world.variation,
        proofs=_proofs(world),
    )


def description_text(world: World) -> str:
    """Returns the content of `world_description.json`."""
    return describe(world).model_dump_json(exclude_none=True) + "\n"


def _proofs(world: World) -> Proofs | None:
    if world.checks is None:
        return None
    broken = violations(world.checks)
    preferences = [*world.floorplan.wishes, *world.wishes]
    return Proofs(guaranteesHold=not broken, violations=broken, checks=world.checks, wishes=preferences)


def _room(room: Room) -> DescribedRoom:
    return DescribedRoom(
        name=room.name,
        originalName=room.original_name,
        type=room.type,
        area=room.area_m2,
        polygon=room.polygon,
        goal=Position(x=room.goal[0], y=room.goal[1]),
        floorMaterial=room.floor_material,
        wallMaterial=room.wall_material,
    )


def _passage(passage: Passage) -> DescribedPassage:
    return DescribedPassage(
        type=passage.kind,
        rooms=passage.rooms,
        start=passage.start,
        end=passage.end,
        width=passage.width_m,
        door=passage.door.id if passage.door else None,
    )


def _door(door: Door, passage: Passage) -> DescribedDoor:
    return DescribedDoor(
        name=door.id,
        rooms=passage.rooms,
        opensInto=door.room,
        hinge=Pose(x=door.hinge[0], y=door.hinge[1], yaw=door.closed_yaw),
        axis=(0.0, 0.0, float(door.swing)),
        maxAngle=door.max_angle_rad,
        size=Size(width=door.leaf_width_m, depth=door.thickness_m, height=door.leaf_height_m),
        clearWidth=door.clear_width_m,
        initialOpening=Opening(percent=door.open_percent, angle=round(door.open_angle_rad, 4)),
        style=door.style,
    )


def _furniture(item: Furniture) -> DescribedFurniture:
    return DescribedFurniture(
        name=item.id,
        modelType=item.model_type,
        style=item.style,
        room=item.room,
        pose=Pose(x=item.x, y=item.y, z=item.base_m, yaw=item.yaw),
        size=Size(width=item.width_m, depth=item.depth_m, height=item.height_m),
        movable=item.movable,
    )
