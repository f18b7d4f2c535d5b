"""A small furnished flat, written by hand, so that these tests need no world generator."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.worlds.world import RoomType

os.environ.setdefault("MUJOCO_GL", "egl")

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.worlds.world import Floorplan, Furniture, Passage, Room, World
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.recording.recording import Recorder

WALLS = [  # name, x0, x1, y0, y1
    ("wall-south", -2.05, 6.05, -1.05, -0.95),
    ("wall-west", -2.05, -1.95, -1.05, 5.05),
    ("wall-east", 5.95, 6.05, -1.05, 5.05),
    ("wall-north", -2.05, 6.05, 4.95, 5.05),
    ("wall-1", -2.05, 0.0, 0.95, 1.05),
    ("wall-2", 0.9, 4.0, 0.95, 1.05),
    ("wall-3", 4.9, 6.05, 0.95, 1.05),
    ("wall-4", 2.95, 3.05, 1.05, 2.5),
    ("wall-5", 2.95, 3.05, 3.4, 5.05),
]
ROOMS: list[
    tuple[str, RoomType, float, float, float, float, tuple[float, float]]
] = [  # name, type, x0, x1, y0, y1, goal
    ("hall", "Hallway", -2.0, 6.0, -1.0, 1.0, (2.0, 0.0)),
    ("living", "Living", -2.0, 3.0, 1.0, 5.0, (0.0, 2.2)),
    ("kitchen", "Kitchen", 3.0, 6.0, 1.0, 5.0, (4.5, 2.9)),
]
TABLES = [  # id, x, y, width, depth, height
    ("Living/CoffeeTables-1", 0.4, 3.3, 1.0, 0.6, 0.5),
    ("Kitchen/DiningTables-1", 4.8, 3.9, 1.2, 0.8, 0.75),
]
SOLIDS = [  # id, x, y, width (x), depth (y), height
    ("Living/Sofas-1", 0.4, 4.5, 2.0, 0.8, 0.8),
    ("Living/Bookcases-1", -1.75, 2.5, 0.35, 1.2, 1.8),
    ("Kitchen/Fridges-1", 5.6, 1.45, 0.6, 0.65, 1.8),
    ("Hall/Storage-1", 5.7, 0.0, 0.4, 0.9, 1.2),
]


def box(name: str, x0: float, x1: float, y0: float, y1: float, z0: float, z1: float, rgba: str) -> str:
    pos = f"{(x0 + x1) / 2:.4f} {(y0 + y1) / 2:.4f} {(z0 + z1) / 2:.4f}"
    size = f"{(x1 - x0) / 2:.4f} {(y1 - y0) / 2:.4f} {(z1 - z0) / 2:.4f}"
    return f'<geom name="{name}" type="box" pos="{pos}" size="{size}" rgba="{rgba}"/>'


def furniture_boxes() -> list[tuple[str, float, float, float, float, float, float]]:
    boxes = []
    for name, x, y, w, d, h in SOLIDS:
        boxes.append((f"{name}/body", x - w / 2, x + w / 2, y - d / 2, y + d / 2, 0.0, h))
    for name, x, y, w, d, h in TABLES:
        boxes.append((f"{name}/top", x - w / 2, x + w / 2, y - d / 2, y + d / 2, h - 0.04, h))
        for i, (sx, sy) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)]):
            lx, ly = x + sx * (w / 2 - 0.03), y + sy * (d / 2 - 0.03)
            boxes.append((f"{name}/leg-{i}", lx - 0.02, lx + 0.02, ly - 0.02, ly + 0.02, 0.0, h - 0.04))
    return boxes


def mjcf(loose: list[tuple[str, float, float, float]], clutter: int) -> str:
    """Loose objects are cubes: id, x, y, half side in metres; clutter is more shelf boards."""
    rows = [box(name, x0, x1, y0, y1, 0.0, 2.5, ".85 .83 .78 1") for name, x0, x1, y0, y1 in WALLS]
    rows += [box(*piece, ".6 .45 .3 1") for piece in furniture_boxes()]
    for i in range(clutter):
        z = 0.3 + 0.02 * (i % 60)
        y = 1.95 + 0.06 * (i // 60)
        rows.append(box(f"Living/Bookcases-1/board-{i}", -1.74, -1.58, y, y + 0.05, z, z + 0.01, ".5 .4 .3 1"))
    for name, x, y, half in loose:
        rows.append(
            f'<body name="{name}" pos="{x} {y} {half}"><freejoint/>'
            f'<geom name="{name}/body" type="box" size="{half} {half} {half}" density="250" rgba=".2 .5 .8 1"/></body>'
        )
    body = "\n".join(rows)
    return f"""<mujoco model="flat">
      <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"><flag sleep="enable"/></option>
      <visual><quality offsamples="0"/><global offwidth="1280" offheight="960"/></visual>
      <worldbody>
      <light pos="2 2 6" dir="0 0 -1" directional="true" castshadow="false"/>
      <geom name="floor" type="box" pos="2 2 -0.05" size="4.05 3.05 0.05" rgba=".75 .7 .62 1"/>
      {body}
      </worldbody></mujoco>"""


def write_map(folder: Path) -> None:
    res, ox, oy, rows, cols = 0.05, -2.5, -1.5, 140, 180
    image = np.full((rows, cols), 205, np.uint8)

    def fill(x0: float, x1: float, y0: float, y1: float, value: int) -> None:
        c0, c1 = math.floor((x0 - ox) / res + 1e-6), math.ceil((x1 - ox) / res - 1e-6)
        r0, r1 = math.floor((y0 - oy) / res + 1e-6), math.ceil((y1 - oy) / res - 1e-6)
        image[r0:r1, c0:c1] = value

    fill(-2.05, 6.05, -1.05, 5.05, 254)
    for _, x0, x1, y0, y1 in WALLS:
        fill(x0, x1, y0, y1, 0)
    for _, x0, x1, y0, y1, z0, _ in furniture_boxes():
        if z0 < 0.4:
            fill(x0, x1, y0, y1, 0)
    (folder / "map.pgm").write_bytes(f"P5\n{cols} {rows}\n255\n".encode() + image[::-1].tobytes())
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nmode: trinary\nresolution: {res}\norigin: [{ox}, {oy}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def describe_world(loose: list[tuple[str, float, float, float]]) -> World:
    rooms = [
        Room(
            name=name,
            type=kind,
            polygon=[(x0, y0), (x1, y0), (x1, y1), (x0, y1)],
            area_m2=(x1 - x0) * (y1 - y0),
            desired_area_m2=(x1 - x0) * (y1 - y0),
            desired_aspect_ratio=1.0,
            goal=goal,
        )
        for name, kind, x0, x1, y0, y1, goal in ROOMS
    ]
    pieces = [
        Furniture(
            id=name, model_type="Storage", room="living", x=x, y=y, yaw=math.pi / 2, width_m=w, depth_m=d, height_m=h
        )
        for name, x, y, w, d, h in SOLIDS + TABLES
    ]
    pieces += [
        Furniture(
            id=name, model_type="Box", room="hall", x=x, y=y, yaw=0.0, width_m=2 * half, depth_m=2 * half,
            height_m=2 * half, movable=True,
        )
        for name, x, y, half in loose
    ]  # fmt: skip
    doorway = Passage(
        kind="Doorway", rooms=("hall", "living"), start=(0.0, 1.0), end=(0.9, 1.0), width_m=0.9, requested=True
    )
    plan = Floorplan(
        footprint=[(-2.0, -1.0), (6.0, -1.0), (6.0, 5.0), (-2.0, 5.0)],
        ceiling_height_m=2.5,
        rooms=rooms,
        walls=[],
        passages=[doorway],
        wishes=[],
    )
    return World(
        generator_version="test", floorplan_seed=1, interior_seed=1, floorplan=plan, furniture=pieces, wishes=[]
    )


MakeContext = Callable[..., SimulationContext]


@pytest.fixture
def make_context(tmp_path: Path) -> MakeContext:
    """Makes a context in the hand-written flat; loose cubes are (id, x, y, half side)."""

    def make(
        seed: int = 1,
        loose: list[tuple[str, float, float, float]] | None = None,
        environment: dict[str, str] | None = None,
        recorder: Any = None,
        with_world: bool = True,
        clutter: int = 0,
    ) -> SimulationContext:
        folder = tmp_path / f"world-{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        loose = loose or []
        world = describe_world(loose)
        (folder / "world.xml").write_text(mjcf(loose, clutter))
        (folder / "world.json").write_text(world.model_dump_json())
        write_map(folder)
        plan = RunPlan(
            job_id="sim-1",
            job_arn="arn:aws:robomaker:local:000000000000:simulation-job/sim-1",
            run_id="run-1",
            seed=seed,
            max_duration_s=600.0,
            world_dir=folder,
            work_dir=tmp_path,
            output_dir=tmp_path,
        )
        return SimulationContext(
            plan=plan,
            rng=np.random.default_rng(seed),
            world=world if with_world else None,
            world_dir=folder if with_world else None,
            data_dir=None,
            output_dir=tmp_path,
            environment=environment or {},
            recorder=recorder or Recorder(),
        )

    return make
