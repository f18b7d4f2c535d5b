"""Facts of a world as plain data: `robomaker world show` prints them, as text or as JSON."""

from collections import Counter
from typing import Any

from ....schemas.worlds.world import Passage, Room, World
from ..inputs.worlds import FoundWorld


def world_facts(found: FoundWorld) -> dict[str, Any]:
    """The facts in the form of the JSON answer; lengths in metres, areas in square metres."""
    from ....tasks.worldforge.proofs.guarantees import proof_lines, violations

    world = found.world
    proofs = [line._asdict() for line in proof_lines(world)]
    broken = violations(world.checks) if world.checks else []
    return {
        "schema_version": 1,
        "name": found.name,
        "arn": found.arn,
        "template": {"arn": found.template_arn, "name": found.template_name, "version": world.template_version},
        "job": {"arn": found.job_arn, "seed": found.job_seed},
        "floorplan_seed": world.floorplan_seed,
        "interior_seed": world.interior_seed,
        "interior_attempt": world.interior_attempt,
        "generator_version": world.generator_version,
        "source": world.source and world.source.model_dump(mode="json"),
        "variation": world.variation and world.variation.model_dump(mode="json"),
        "appearance": world.appearance,
        "closed_off_rooms": world.checks.closed_off_rooms if world.checks else [],
        "content_sha256": found.content,
        "bundle": {
            "stored_at": found.stored_at,
            "local": str(found.folder),
            "as_stored": None if found.stored_content is None else found.stored_content == found.content,
        },
        "building": _building(world),
        "rooms": [_room(room, world) for room in world.floorplan.rooms],
        "passages": [_passage(index, passage, world) for index, passage in enumerate(world.floorplan.passages)],
        "proven": None if world.checks is None else not broken,
        "broken": broken,
        "proofs": proofs,
        "wishes": _preferences(world),
    }


def _building(world: World) -> dict[str, Any]:
    plan = world.floorplan
    xs, ys = zip(*plan.footprint, strict=True)
    return {
        "width_m": round(max(xs) - min(xs), 3),
        "depth_m": round(max(ys) - min(ys), 3),
        "ceiling_height_m": plan.ceiling_height_m,
        "area_m2": round(sum(room.area_m2 for room in plan.rooms), 2),
        "windows": len(plan.windows),
    }


def _room(room: Room, world: World) -> dict[str, Any]:
    here = [item for item in world.furniture if item.room == room.name]
    pieces = Counter(item.model_type for item in here if not item.movable)
    return {
        "name": room.name,
        "original_name": room.original_name,
        "type": room.type,
        "area_m2": round(room.area_m2, 2),
        "floor_area_m2": round(room.floor_m2, 2),
        "desired_area_m2": room.desired_area_m2,
        "aspect_ratio": None if room.aspect_ratio is None else round(room.aspect_ratio, 2),
        "desired_aspect_ratio": round(room.desired_aspect_ratio, 2),
        "floor": _surface(room.floor_material, room.floor_finish),
        "walls": _surface(room.wall_material, room.wall_finish),
        "pieces": dict(pieces.most_common()),
        "loose_objects": sum(item.movable for item in here),
    }


def _surface(material: str, finish: str) -> str:
    return f"{material} ({finish})" if finish else material


def _passage(index: int, passage: Passage, world: World) -> dict[str, Any]:
    graph = world.checks.room_graph if world.checks else []
    measured = graph[index].clear_width_m if index < len(graph) else None
    door = passage.door
    return {
        "rooms": list(passage.rooms),
        "kind": passage.kind,
        "width_m": round(passage.width_m, 3),
        "clear_width_m": measured,
        "requested": passage.requested,
        "door": None
        if door is None
        else {
            "id": door.id,
            "style": door.style,
            "opens_into": door.room,
            "open_percent": door.open_percent,
            "clear_width_m": round(door.clear_width_m, 3),
        },
    }


def _preferences(world: World) -> dict[str, Any]:
    preferences = [*world.floorplan.wishes, *world.wishes]
    counts = Counter(preference.outcome for preference in preferences)
    return {
        "satisfied": counts["satisfied"],
        "missed": counts["missed"],
        "contradictory": counts["contradictory"],
        "not_granted": [preference.model_dump() for preference in preferences if preference.outcome != "satisfied"],
    }
