"""Collects facts about a world as JSON data, and formats them as text."""

import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from ....schemas.exit_codes import OK, VERDICT_FAILED
from ....schemas.wire.common import counted
from ....schemas.worlds.world import Passage, Room, World
from ..inputs.world_lookup import FoundWorld, find_world
from .answers import Cell, print_lines


def world_facts(found: FoundWorld) -> dict[str, Any]:
    """Collects facts about a world for JSON output; lengths in metres, areas in square metres."""
    from ....tasks.worldforge.proofs.guarantees import proof_lines, violations
    from ....tasks.worldforge.proofs.standing_doors import rooms_behind_doors

    world = found.world
    proofs = [line._asdict() for line in proof_lines(world)]
    broken = violations(world.checks) if world.checks else []
    return {
        "schema_version": 1,
        "name": found.name,
        "id": found.id,
        "arn": found.arn,
        "template": {
            "arn": found.template_arn,
            "name": found.template_name,
            "version": world.template_version,
            "changed": found.template_changed,
        },
        "job": {"arn": found.job_arn, "seed": found.job_seed},
        "floorplan_seed": world.floorplan_seed,
        "interior_seed": world.interior_seed,
        "interior_attempt": world.interior_attempt,
        "generator_version": world.generator_version,
        "source": world.source and world.source.model_dump(mode="json"),
        "variation": world.variation and world.variation.model_dump(mode="json"),
        "appearance": world.appearance,
        "closed_off_rooms": rooms_behind_doors(world),
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
        "wishes": _preference_facts(world),
    }


def _building(world: World) -> dict[str, Any]:
    plan = world.floorplan
    xs, ys = zip(*plan.footprint, strict=True)
    return {
        "width_m": round(max(xs) - min(xs), 3),
        "depth_m": round(max(ys) - min(ys), 3),
        "ceiling_height_m": plan.ceiling_height_m,
        "area_m2": round(sum(room.area_m2 for room in plan.rooms), 2),
        "floor_area_m2": round(sum(room.floor_m2 for room in plan.rooms), 2),
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


def _preference_facts(world: World) -> dict[str, Any]:
    preferences = [*world.floorplan.wishes, *world.wishes]
    counts = Counter(preference.outcome for preference in preferences)
    return {
        "satisfied": counts["satisfied"],
        "missed": counts["missed"],
        "contradictory": counts["contradictory"],
        "not_granted": [preference.model_dump() for preference in preferences if preference.outcome != "satisfied"],
    }


Line = list[Cell]

_MARKS: dict[str, Cell] = {
    "holds": ("✓", "green"),
    "broken": ("✗", "bold red"),
    "not measured": ("?", "yellow"),
    "warning": ("!", "yellow"),
    "": ("·", "dim"),
}


def print_world(form: str, document: dict[str, Any], lines: Sequence[Line]) -> None:
    """Prints an answer about a world as JSON for programs, or as lines for people."""
    if form == "json":
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False) + "\n")
    else:
        print_lines([[(_printable(text), style) for text, style in line] for line in lines], sys.stdout)


def proof_lines_of(facts: dict[str, Any]) -> list[Line]:
    """Returns the measured guarantees of a world as lines."""
    return [_verdict(facts), *_proofs(facts)]


def print_kept(arn: str, form: str) -> int:
    """Prints facts about a newly stored world, its ARN first, and returns the exit code.

    Args:
        arn: The world.
        form: `text` or `json`.
    """
    facts = world_facts(find_world(arn))
    lines: list[Line] = [[(facts["arn"], "")], _verdict(facts)]
    lines += [[("    ", ""), (sentence, "red")] for sentence in facts["broken"]]
    lines += [[(f"  {what:<9} ", "dim"), (said, "")] for what, said in _origin(facts)]
    if facts["closed_off_rooms"]:
        lines.append([("  behind doors not open enough: ", ""), (", ".join(facts["closed_off_rooms"]), "yellow")])
    if facts["variation"] is None:
        lines += _preferences(facts)
    print_world(form, facts, lines)
    return OK if facts["proven"] else VERDICT_FAILED


def fact_lines(facts: dict[str, Any]) -> list[Line]:
    """Formats facts about a world as lines of styled text."""
    return [
        *_head(facts),
        [],
        [("rooms", "bold")],
        *_table([("name", "type", "area", "aim", "aspect", "aim", "floor", "walls", "pieces", "loose")], _rooms(facts)),
        *_ways(facts),
        [],
        [("proofs", "bold")],
        *_proofs(facts),
        [],
        *_preferences(facts),
        *_pictures(facts.get("pictures", [])),
    ]


def _printable(text: str) -> str:
    """Replaces what is not printable in a text, line breaks too, by U+FFFD: names in it could control the terminal."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


def _verdict(facts: dict[str, Any]) -> Line:
    verdict = {
        True: ("all guarantees hold", "green"),
        False: ("guarantees are broken", "bold red"),
        None: ("never checked", "yellow"),
    }[facts["proven"]]
    own = facts.get("id")
    return [
        (facts["name"], "bold"),
        *([(f" ({own})", "dim")] if own and own != facts["name"] else []),
        (": ", ""),
        verdict,
    ]


def _head(facts: dict[str, Any]) -> Iterator[Line]:
    yield _verdict(facts)
    yield []
    for what, where in _places(facts):
        yield [(f"  {what:<9} ", "dim"), (where, "")]


def _places(facts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    template, job, bundle, building = facts["template"], facts["job"], facts["bundle"], facts["building"]
    if facts["arn"]:
        yield "world", facts["arn"]
    if template["arn"]:
        since = ", which has another body now" if template["changed"] else ""
        yield "template", f"{template['name'] or 'deleted'}, {template['arn']}{since}"
    if job["arn"]:
        yield "job", job["arn"] + ("" if job["seed"] is None else f", seed {job['seed']}")
    attempts = facts["interior_attempt"] + 1
    tries = f" (attempt {attempts})" if attempts > 1 else ""
    yield "seeds", f"floor plan {facts['floorplan_seed']}, interior {facts['interior_seed']}{tries}"
    yield "generator", f"{facts['generator_version']}, template version {template['version']}"
    yield from _origin(facts)
    state = {True: ", as it was stored", False: ", NOT what was stored", None: ""}[bundle["as_stored"]]
    yield "content", f"sha256 {facts['content_sha256']}{state}"
    if bundle["stored_at"]:
        yield "stored", bundle["stored_at"]
    yield "copy" if bundle["stored_at"] else "bundle", bundle["local"]
    size = f"{building['width_m']:.2f} x {building['depth_m']:.2f} m, {building['ceiling_height_m']:.2f} m high"
    rooms = counted(len(facts["rooms"]), "room")
    yield "building", f"{size}, {rooms}, {building['floor_area_m2']:.1f} m² inside the walls"


def _origin(facts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yields the source and the changes of a world that no generation job made, each as a title and a text."""
    source, variation = facts["source"], facts["variation"]
    if source and source["form"] == "gazebo":
        yield from _gazebo_origin(source)
    elif source:
        scale = f"{source['metres_per_unit']:g} m a {'cell' if source['form'] == 'nav2-map' else 'unit'}"
        lines = {"faces": "the faces of walls", "centres": "the middles of walls"}[source["outlines"]]
        yield "drawn", f"{source['file']}, {scale}, outlines are {lines}, sha256 {source['sha256']}"
        if source["origin_m"]:
            (x, y), where = source["origin_m"], "map" if source["form"] == "nav2-map" else "drawing"
            yield "origin", f"at ({x:.2f}, {y:.2f}) m of the {where}"
        for room in facts["rooms"]:
            if room["original_name"] is not None:
                yield "named", f"{room['name']} for {room['original_name']!r}, as names of rooms have plain letters"
        if source["left_out"]:
            yield "left out", ", ".join(source["left_out"])
    if variation:
        yield "varied", f"from {variation['of_world'] or variation['of_content']}"
        for change in variation["changes"]:
            yield change["what"], f"{change['thing']}: {change['before']} -> {change['after']}"


def _gazebo_origin(source: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yields a world's Gazebo file, and its parts that were held or left out, each as a title and a text."""
    yield (
        "imported",
        f"{source['file']}, SDF {source['sdf_version']}, {source['models']} models, sha256 {source['sha256']}",
    )
    x, y, z = source["origin_m"]
    chosen = ", a free place that was chosen" if source["is_start_chosen"] else ""
    chosen = f", the start of {source['start_from']}" if source["start_from"] else chosen
    yield "origin", f"at ({x:.2f}, {y:.2f}, {z:.2f}) m of the file, yaw {source['start_yaw']:.2f}{chosen}"
    for name, reason in source["held"].items():
        yield "held", f"{name}: {reason}"
    for left in source["left_out"]:
        more = ", ..." if left["count"] > len(left["names"]) else ""
        yield "left out", f"{left['count']} {left['what']}: {', '.join(left['names'])}{more}"


def _rooms(facts: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for room in facts["rooms"]:
        aspect = room["aspect_ratio"]
        original = "" if room["original_name"] is None else f" ({room['original_name']})"
        yield (
            room["name"] + original,
            room["type"],
            f"{room['floor_area_m2']:.1f} m²",
            f"{room['desired_area_m2']:.1f} m²",
            "" if aspect is None else f"{aspect:.2f}",
            f"{room['desired_aspect_ratio']:.2f}",
            room["floor"],
            room["walls"],
            str(sum(room["pieces"].values())),
            str(room["loose_objects"]),
        )


def _ways(facts: dict[str, Any]) -> Iterator[Line]:
    if not facts["passages"]:
        return
    yield []
    yield [("ways between rooms", "bold")]
    yield from _table([("between", "kind", "clear", "door", "")], (_way(passage) for passage in facts["passages"]))


def _way(passage: dict[str, Any]) -> tuple[str, ...]:
    clear = passage["clear_width_m"]
    return (
        " - ".join(passage["rooms"]),
        passage["kind"],
        f"{passage['width_m'] if clear is None else clear:.2f} m",
        _door(passage["door"]),
        "wished" if passage["requested"] else "added, so that all rooms are joined",
    )


def _door(door: dict[str, Any] | None) -> str:
    if door is None:
        return "none"
    style = f"{door['id']} {door['style']}".rstrip()
    return f"{style}, {door['open_percent']:g} % open into {door['opens_into']}"


def _proofs(facts: dict[str, Any]) -> Iterator[Line]:
    width = max(len(proof["name"]) for proof in facts["proofs"])
    for proof in facts["proofs"]:
        mark, style = _MARKS[proof["verdict"]]
        value_style = style if proof["verdict"] == "broken" else ""
        yield [("  ", ""), (mark, style), (f" {proof['name'].ljust(width)}  ", ""), (proof["value"], value_style)]
    for sentence in facts["broken"]:
        yield [("    ", ""), (sentence, "red")]


def _preferences(facts: dict[str, Any]) -> Iterator[Line]:
    if facts["source"] and facts["source"]["form"] == "gazebo":
        return  # it wishes nothing
    preferences, whose = facts["wishes"], "drawing" if facts["source"] else "template"
    counts = ", ".join(
        f"{preferences[key]} {word}"
        for key, word in (("satisfied", "granted"), ("missed", "missed"), ("contradictory", "contradictory"))
        if preferences[key] or key == "satisfied"
    )
    yield [(f"wishes of the {whose}: ", "bold"), (counts, "")]
    for preference in preferences["not_granted"]:
        yield [
            ("  ✗ ", "yellow"),
            (preference["wish"], ""),
            ("" if preference["outcome"] == "missed" else " (contradictory)", "yellow"),
        ]
        yield [("    ", ""), (preference["reason"], "")]
        yield [("    ", ""), (preference["path"], "dim")]


def _pictures(paths: Sequence[str]) -> Iterator[Line]:
    if paths:
        yield []
        yield [("pictures", "bold")]
        yield from ([("  ", ""), (path, "")] for path in paths)


def _table(head: list[tuple[str, ...]], rows: Iterator[tuple[str, ...]]) -> Iterator[Line]:
    """Formats a table: text columns are aligned left, numbers right."""
    cells = [*head, *rows]
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    numeric = [
        all(row[column][:1].isdigit() or not row[column] for row in cells[1:]) and len(cells) > 1
        for column in range(len(widths))
    ]
    for number, row in enumerate(cells):
        padded = [
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, numeric, strict=True)
        ]
        yield [("  " + "  ".join(padded).rstrip(), "dim" if number == 0 else "")]
