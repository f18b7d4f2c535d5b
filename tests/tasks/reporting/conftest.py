"""A small flat, runs in it, and reports of them."""

import io
import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from PIL import Image, ImageDraw

from prefect_robomaker.schemas.reports.report import Report, ReportedFile, ReportedJob, ReportedStep, ReportedWorld
from prefect_robomaker.schemas.runs.plan import Collision, Requirement, RoomVisit, RunResult
from prefect_robomaker.schemas.worlds.world import (
    Floorplan,
    Furniture,
    Passage,
    Preference,
    Room,
    Wall,
    Window,
    World,
)

START = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)
ROOMS: dict[str, tuple[str, float, float, float, float]] = {
    "Living_Room": ("Living", -3.0, -2.0, 2.0, 3.0),
    "Kitchen": ("Kitchen", 2.0, -2.0, 5.5, 1.0),
    "Hallway": ("Hallway", -3.0, -3.3, 5.5, -2.0),
    "Bedroom": ("Bedroom", -3.0, -7.0, 1.0, -3.3),
    "Bathroom": ("Bathroom", 1.0, -7.0, 3.4, -3.3),
    "Closet": ("Closet", 3.4, -7.0, 5.5, -3.3),
    "Dining": ("Dining", 2.0, 1.0, 5.5, 3.0),
}
PIECES = [
    ("Sofas", "Living_Room", -0.5, 2.45, -90, 2.2, 0.9), ("CoffeeTables", "Living_Room", -0.5, 1.2, -90, 1.2, 0.6),
    ("LivingRoomChairs", "Living_Room", -2.3, 1.1, -20, 0.8, 0.8),
    ("Bookcases", "Living_Room", -2.78, -0.8, 0, 1.6, 0.35),
    ("FloorLamps", "Living_Room", 1.6, 2.6, 0, 0.4, 0.4), ("Ovens", "Kitchen", 5.12, 0.5, 180, 0.6, 0.6),
    ("Fridges", "Kitchen", 5.1, -0.3, 180, 0.7, 0.65), ("DishWashers", "Kitchen", 5.12, -1.1, 180, 0.6, 0.6),
    ("Beds", "Bedroom", -1.2, -5.9, 90, 1.8, 2.05), ("Nightstands", "Bedroom", -2.5, -6.7, 90, 0.45, 0.4),
    ("Dressers", "Bedroom", 0.7, -4.4, 180, 1.2, 0.45), ("Toilets", "Bathroom", 1.45, -6.3, 0, 0.4, 0.7),
    ("Baths", "Bathroom", 2.9, -5.9, 180, 1.7, 0.75), ("VanityCounters", "Bathroom", 1.35, -4.6, 0, 0.9, 0.5),
    ("Storage", "Closet", 5.2, -5.5, 180, 1.5, 0.45), ("DiningTables", "Dining", 3.8, 2.0, 0, 0.9, 1.5),
    ("DiningChairs", "Dining", 2.75, 2.0, 0, 0.45, 0.45), ("DiningChairs", "Dining", 4.85, 2.0, 180, 0.45, 0.45),
    ("DiningChairs", "Dining", 3.8, 2.68, -90, 0.45, 0.45),
]  # fmt: skip
DOORS = [
    ("Living_Room", "Hallway", (-0.9, -2.0), (0.0, -2.0)), ("Kitchen", "Hallway", (3.0, -2.0), (3.9, -2.0)),
    ("Hallway", "Bedroom", (-1.5, -3.3), (-0.6, -3.3)), ("Hallway", "Bathroom", (1.8, -3.3), (2.7, -3.3)),
    ("Hallway", "Closet", (4.0, -3.3), (4.8, -3.3)), ("Living_Room", "Dining", (2.0, 1.5), (2.0, 2.4)),
]  # fmt: skip
TOUR = [
    (0, 0), (-0.45, -1), (-0.45, -2.6), (-1.05, -2.7), (-1.05, -4.2), (0.2, -5.4), (-0.2, -4.2), (-1.05, -3.6),
    (-0.6, -2.65), (2.25, -2.65), (2.25, -4.8), (2.2, -3.5), (3.4, -2.6), (3.45, -1.2), (4.2, -0.3), (3.4, -0.8),
    (3.45, -2.5), (0, -2.6), (-0.45, -1.4), (1.2, 0.4), (1.4, 1.9), (2.5, 1.95),
]  # fmt: skip


def _wall(start: tuple[float, float], end: tuple[float, float], exterior: bool) -> Wall:
    return Wall(start=start, end=end, thickness_m=0.2 if exterior else 0.1, exterior=exterior, rooms=["Hallway"])


def _cut(start: float, end: float, gaps: list[tuple[float, float]]) -> list[tuple[float, float]]:
    pieces = []
    for low, high in sorted(gaps):
        pieces.append((start, low))
        start = high
    return [*pieces, (start, end)]


def _walls() -> list[Wall]:
    """Walls of the flat: (fixed coordinate, from, to, horizontal, exterior)."""
    lines = [
        (3.0, -3.1, 5.6, True, True), (-7.0, -3.1, 5.6, True, True), (-3.0, -6.9, 2.9, False, True),
        (5.5, -6.9, 2.9, False, True), (-2.0, -3.0, 5.5, True, False), (-3.3, -3.0, 5.5, True, False),
        (2.0, -2.0, 3.0, False, False), (1.0, 2.0, 5.5, True, False), (1.0, -7.0, -3.3, False, False),
        (3.4, -7.0, -3.3, False, False),
    ]  # fmt: skip
    walls = []
    for fixed, low, high, horizontal, exterior in lines:
        axis, other = (0, 1) if horizontal else (1, 0)
        gaps = [(a[axis], b[axis]) for _, _, a, b in DOORS if a[other] == b[other] == fixed]
        for start, end in _cut(low, high, gaps):
            ends = [(start, fixed), (end, fixed)] if horizontal else [(fixed, start), (fixed, end)]
            walls.append(_wall(ends[0], ends[1], exterior))
    return walls


def _room(name: str, kind: Any, left: float, bottom: float, right: float, top: float) -> Room:
    return Room(
        name=name,
        type=kind,
        polygon=[(left, bottom), (right, bottom), (right, top), (left, top)],
        area_m2=(right - left) * (top - bottom),
        desired_area_m2=12.0,
        desired_aspect_ratio=1.0,
        goal=((left + right) / 2, (bottom + top) / 2),
    )


def build_world(rename: dict[str, str] | None = None) -> World:
    names = {name: (rename or {}).get(name, name) for name in ROOMS}
    return World(
        generator_version="1",
        floorplan_seed=11,
        interior_seed=12,
        floorplan=Floorplan(
            footprint=[(-3.0, -7.0), (5.5, -7.0), (5.5, 3.0), (-3.0, 3.0)],
            ceiling_height_m=2.6,
            rooms=[_room(names[name], *values) for name, values in ROOMS.items()],
            walls=_walls(),
            passages=[
                Passage(kind="Doorway", rooms=(names[a], names[b]), start=s, end=e, width_m=0.9, requested=True)
                for a, b, s, e in DOORS
            ],
            windows=[
                Window(start=(-1.2, 3.0), end=(0.6, 3.0), room=names["Living_Room"]),
                Window(start=(-3.0, -5.6), end=(-3.0, -4.4), room=names["Bedroom"]),
            ],
            wishes=[Preference(path="$.Floorplan.Rooms[0].Area", wish="area 12 m²", outcome="satisfied")],
        ),
        furniture=[
            Furniture(
                id=f"{kind}-{index}", model_type=kind, room=names[room], x=x, y=y, yaw=math.radians(degrees),
                width_m=width, depth_m=depth, height_m=0.8,
            )
            for index, (kind, room, x, y, degrees, width, depth) in enumerate(PIECES)
        ],
        wishes=[
            Preference(
                path="$.Interior.Furniture[3]", wish="2 to 4 plants", outcome="missed", reason="no free wall is left"
            )
        ],
    )  # fmt: skip


def build_result(verdict: Any, legs: int, hits: int = 0) -> RunResult:
    """A drive over the first `legs` legs of the tour at 0.5 m/s, with `hits` collisions."""
    path, time_s = [], 0.0
    for (x0, y0), (x1, y1) in pairwise(TOUR[: legs + 1]):
        length = math.dist((x0, y0), (x1, y1))
        for step in range(20):
            share = step / 20
            path.append((time_s + share * length * 2, x0 + share * (x1 - x0), y0 + share * (y1 - y0)))
        time_s += length * 2
    seen = {
        name: next((t for t, x, y in path if left < x < right and bottom < y < top), None)
        for name, (_, left, bottom, right, top) in ROOMS.items()
    }
    visited = sum(first is not None for first in seen.values())
    spots = [path[(index * 97 + 60) % len(path)] for index in range(hits)]
    return RunResult(
        verdict=verdict,
        summary=f"Visited {visited} of {len(ROOMS)} rooms in {time_s:.0f} s.",
        requirements=[
            Requirement(name="rooms_visited", satisfied=verdict == "PASS", detail=f"{visited}, at least 5 asked"),
            Requirement(name="collisions", satisfied=hits == 0, detail=f"{hits}, at most 0 asked"),
        ],
        metrics={
            "distance_m": time_s / 2, "collisions": float(hits), "max_force_N": 12.0 + 31 * hits,
            "replans": 4.0, "mean_speed_m_s": 0.4871,
        },
        rooms=[RoomVisit(name=n, visited=first is not None, first_visit_s=first) for n, first in seen.items()],
        collisions=[
            Collision(
                time_s=t, duration_s=0.2, x=x, y=y, other="wall" if i % 2 else "Beds-8", max_force_N=43.0 + 31 * i
            )
            for i, (t, x, y) in enumerate(spots)
        ],
        path=path[:600],
        sim_time_s=time_s,
        wall_time_s=time_s / 21,
        real_time_factor=21.0,
        ended_by="environment" if verdict == "PASS" else "duration limit",
        seed=7,
    )  # fmt: skip


def build_picture(hue: int, width: int = 640, height: int = 480) -> bytes:
    image = Image.new("HSV", (width, height), (hue, 90, 170)).convert("RGB")
    draw = ImageDraw.Draw(image)
    for index in range(40):
        draw.rectangle([index * 16, index * 9, index * 16 + 60, index * 9 + 80], outline=(255, 255, 255))
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def build_job(label: str, world_arn: str | None, **values: Any) -> ReportedJob:
    folder = f"file:///data/out/{label}/run-1/"
    names = {"recording.mcap": 4_180_000, "result.json": 5_120, "logs/stdout.log": 812, "video.mp4": 2_600_000}
    defaults: dict[str, Any] = {
        "label": label,
        "arn": f"arn:aws:robomaker:us-east-1:000000000000:simulation-job/{label}",
        "status": "Completed",
        "world_arn": world_arn,
        "files": [ReportedFile(name=name, uri=folder + name, size_bytes=size) for name, size in names.items()],
        "duration_s": 7.4,
    }
    return ReportedJob(**{**defaults, **values})


@pytest.fixture
def make_world(tmp_path: Path) -> Callable[..., ReportedWorld]:
    """Makes a reported world with `world.json` on disk."""

    def make(number: int = 1, world: World | None = None, preview: bool = True) -> ReportedWorld:
        file = tmp_path / f"world-{number}.json"
        file.write_text((world or build_world()).model_dump_json())
        return ReportedWorld(
            arn=f"arn:aws:robomaker:us-east-1:000000000000:world/w{number}",
            label=f"generation-1/world-{number}",
            world_json=file,
            floorplan_svg='<svg xmlns="http://www.w3.org/2000/svg"/>',
            preview_png=build_picture(number * 37 % 255) if preview else b"",
        )

    return make


@pytest.fixture
def make_job() -> Callable[..., ReportedJob]:
    return build_job


@pytest.fixture
def make_result() -> Callable[..., RunResult]:
    return build_result


@pytest.fixture
def make_report() -> Callable[..., Report]:
    """Makes a report around worlds and jobs."""

    def make(worlds: list[ReportedWorld], jobs: list[ReportedJob], **values: Any) -> Report:
        defaults: dict[str, Any] = {
            "name": "nightly-flats",
            "run_id": "run-20260302-7f3a",
            "state": "failed",
            "started_at": START,
            "ended_at": START + timedelta(seconds=83.4),
            "steps": [
                ReportedStep(name="template", operation="CreateWorldTemplate", status="Completed", duration_s=0.02),
                ReportedStep(
                    name="worlds", operation="CreateWorldGenerationJob", status="Completed", duration_s=21.7,
                    detail="arn:aws:robomaker:us-east-1:000000000000:world-generation-job/wgj-1",
                ),
                ReportedStep(name="drive", operation="StartSimulationJobBatch", status="Completed", duration_s=61.2),
            ],
            "worlds": worlds,
            "jobs": jobs,
            "command": "robomaker run nightly-flats.yaml",
            "where": "build-7, outputs in file:///data/out",
            "versions": {"prefect-robomaker": "0.1.0", "mujoco": "3.17.0", "dm_control": "1.0.50", "Python": "3.11.9"},
        }  # fmt: skip
        return Report(**{**defaults, **values})

    return make


@pytest.fixture
def mixed_report(make_world: Any, make_report: Any) -> Report:
    """Two worlds and five jobs: passed, failed, broken, canceled, passed."""
    worlds = [make_world(1), make_world(2)]
    first, second = worlds[0].arn, worlds[1].arn
    return make_report(
        worlds,
        [
            build_job("sim-pass1", first, result=build_result("PASS", 22)),
            build_job("sim-fail1", first, result=build_result("FAIL", 12, hits=5), poster_png=build_picture(90)),
            build_job(
                "sim-broken1", second, status="Failed", failure_code="RobotApplicationCrash", files=[],
                failure_reason="ZeroDivisionError: division by zero\n  File \"agent.py\", line 12, in act\n"
                "    return goal / distance\n\x1b[31mlast log line\x1b[0m",
            ),
            build_job("sim-cancel1", second, status="Canceled"),
            build_job("sim-pass2", second, result=build_result("PASS", 22, hits=1)),
        ],
    )  # fmt: skip
