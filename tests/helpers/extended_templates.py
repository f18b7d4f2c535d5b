"""Templates that only the extensions allow, drawn at random, and a look at their worlds without their proofs."""

import json
from collections import Counter
from collections.abc import Sequence
from math import exp, log, pi
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prefect_robomaker.schemas.templates.body import LEAST_AREAS_M2, WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.world import INDOOR_ROOM_TYPES, FurnishedRoomType, Furniture, World, contains

ROBOT_M = 0.2
"""Radius of the robot that has to enter each room, in metres."""
WHOLLY_INSIDE_M = 0.25
"""Distance from the line of a doorway at which the whole robot is in the room, half of the wall included."""
LEAST_INSIDE_M2 = 0.05
"""Area that the middle of such a robot has at least: a square of 0.22 m."""
_CELL_M = 0.025
_LARGEST_M2 = 14.0


def extended_template(
    seed: int,
    *,
    rooms: tuple[int, int] = (1, 6),
    types: Sequence[FurnishedRoomType] = INDOOR_ROOM_TYPES,
    most_ways: int = 8,
) -> WorldTemplateBody:
    """One of the bodies: rooms from the least area of their type to 14 m2, any shapes and connections."""
    dice = Random(seed)
    wished = [_room(dice, dice.choice(types), number) for number in range(dice.randint(*rooms))]
    names = [room["Name"] for room in wished]
    ways: list[dict[str, Any]] = []
    degrees: Counter[str] = Counter()
    for _ in range(dice.randint(0, most_ways) if len(names) > 1 else 0):
        pair = dice.sample(names, 2)
        if max(degrees[name] for name in pair) < 4 and not any({*way["Location"]} == {*pair} for way in ways):
            ways.append({"Location": pair, "ConnectionType": dice.choice(("Doorway", "Doorway", "Opening"))})
            degrees.update(pair)
    floor = {"Floorplan": {"Rooms": wished, "DesiredConnections": ways}}
    return parse_template_body(json.dumps({"Version": dice.choice("12"), "Buildings": [{"Floors": [floor]}]}))


def _room(dice: Random, kind: FurnishedRoomType, number: int) -> dict[str, Any]:
    area = max(LEAST_AREAS_M2[kind], round(exp(dice.uniform(log(LEAST_AREAS_M2[kind]), log(_LARGEST_M2))), 1))
    longer = round(exp(dice.uniform(0, log(4))), 2)
    shape = {"Area": area, "AspectRatio": {"x": longer, "y": 1.0}}
    return {"Name": f"{kind} {number}", "Type": kind, "DesiredShape": shape}


def not_entered(world: World) -> list[str]:
    """Names of rooms that a robot from the origin does not wholly enter, by walls and furniture as `world.json` says.

    Doors are fully open. Nothing of the generator's maps and proofs is used.
    """
    plan = world.floorplan
    xs, ys = ([point[axis] for point in plan.footprint] for axis in (0, 1))
    west, south = min(xs) - 0.5, min(ys) - 0.5
    shape = (int((max(ys) + 0.5 - south) / _CELL_M), int((max(xs) + 0.5 - west) / _CELL_M))
    x = np.asarray(west + (np.arange(shape[1]) + 0.5) * _CELL_M, np.float64)
    y = np.asarray(south + (np.arange(shape[0]) + 0.5) * _CELL_M, np.float64)
    free = np.ones(shape, bool)
    for low_x, low_y, high_x, high_y in _standing(world):
        free[np.ix_((y > low_y) & (y < high_y), (x > low_x) & (x < high_x))] = False
    fits = np.asarray(ndimage.distance_transform_edt(free)) > ROBOT_M / _CELL_M
    labels = np.asarray(ndimage.label(fits)[0])  # pyright: ignore[reportIndexIssue]
    start = labels[int(-south / _CELL_M), int(-west / _CELL_M)]
    reached = (labels == start) if start else np.zeros(shape, bool)
    lines = [(*np.minimum(p.start, p.end), *np.maximum(p.start, p.end)) for p in plan.passages]
    for low_x, low_y, high_x, high_y in lines:
        across = np.maximum(0, np.maximum(low_y - y, y - high_y))[:, None]
        along = np.maximum(0, np.maximum(low_x - x, x - high_x))[None]
        reached &= np.hypot(across, along) > WHOLLY_INSIDE_M
    return [room.name for room in plan.rooms if _inside_m2(reached, room.polygon, x, y) < LEAST_INSIDE_M2]


def _inside_m2(
    reached: NDArray[np.bool_], polygon: Sequence[tuple[float, float]], x: NDArray[np.float64], y: NDArray[np.float64]
) -> float:
    rows, columns = np.nonzero(reached)
    inside = sum(contains(polygon, float(x[column]), float(y[row])) for row, column in zip(rows, columns, strict=True))
    return inside * _CELL_M**2


def _standing(world: World) -> list[tuple[float, float, float, float]]:
    boxes: list[tuple[float, float, float, float]] = []
    for wall in world.floorplan.walls:
        if not wall.lintel:
            (x0, y0), (x1, y1) = sorted((wall.start, wall.end))
            half = wall.thickness_m / 2
            boxes.append((x0, y0 - half, x1, y1 + half) if y0 == y1 else (x0 - half, y0, x1 + half, y1))
    for passage in world.floorplan.passages:
        if (door := passage.door) is not None:
            yaw = door.yaw_at(door.max_angle_rad)
            x, y = door.hinge
            u, v = x + door.leaf_width_m * np.cos(yaw), y + door.leaf_width_m * np.sin(yaw)
            boxes.append((min(x, u) - 0.02, min(y, v) - 0.02, max(x, u) + 0.02, max(y, v) + 0.02))
    return [*boxes, *(_box(item) for item in world.furniture if not item.movable)]


def _box(item: Furniture) -> tuple[float, float, float, float]:
    upright = round(item.yaw / (pi / 2)) % 2 == 1
    along, across = (item.width_m, item.depth_m) if upright else (item.depth_m, item.width_m)
    return item.x - along / 2, item.y - across / 2, item.x + along / 2, item.y + across / 2
