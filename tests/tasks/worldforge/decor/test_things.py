"""Small things in rooms: enough of them, on what carries them, and in nobody's way."""

import re
from collections import defaultdict
from functools import cache

import mujoco
import numpy as np
import pytest

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.model.mjcf import decorated_mjcf, world_mjcf

from ..conftest import MakeBody
from .test_decor import box_around, overlap_m

MOST_OVERLAP_M = 0.005
TYPES = ("Bathroom", "Bedroom", "Closet", "Dining", "Hallway", "Kitchen", "Living")
HUNG = r"((?:picture|mirror|clock|shelf|curtain|cabinet|rug|towels|coats)_\w+?_\d+)"


@cache
def dense(make_body: MakeBody, kind: str, seed: int) -> World:
    arrangement = {"Name": "all", "TargetSet": {"RoomNames": ["Room"]}, "DesiredSpatialDensity": "Dense"}
    return generate_world(make_body((("Room", kind, 20.0),), furniture=[arrangement]), seed, seed, settle=False)


def model_of(world: World) -> mujoco.MjModel:
    """The decorated model without pictures, whose files are not there."""
    text, meshes = decorated_mjcf(world)
    files = {path: content.encode() for path, content in meshes.items()}
    return mujoco.MjModel.from_xml_string(re.sub(r'(texture="[^"]*" |<texture .*?/>)', "", text), files)


def thing_of(name: str) -> str | None:
    """Which small thing a geom belongs to."""
    if name.startswith("book_"):
        return name
    found = re.match(r"thing_.*?_\d+_(?:coat|towel|[a-z]+(?:_[a-z]+)?)(?:_\d(?=$)|$)", name)
    if found is None:
        return None
    return re.sub(r"(?<=[a-z])_\d$", "", name) if "_coat_" not in name and "_towel_" not in name else name


@pytest.mark.parametrize("kind", TYPES)
def test_a_dense_room_of_20_m2_has_at_least_40_things(make_body: MakeBody, kind: str) -> None:
    world = dense(make_body, kind, 3)
    names = re.findall(r'<geom name="([^"]*)"', world_mjcf(world, textured=True))
    small = {thing_of(name) for name in names} - {None}
    hung = {found.group(1) for name in names if (found := re.match(HUNG, name))}
    assert len(world.furniture) + len(small) + len(hung) >= 40, kind


def test_an_emptier_room_has_fewer(make_body: MakeBody) -> None:
    arrangement = {"Name": "all", "TargetSet": {"RoomNames": ["Room"]}, "DesiredSpatialDensity": "Sparse"}
    sparse = generate_world(make_body((("Room", "Living", 20.0),), furniture=[arrangement]), 1, 1, settle=False)
    counts = [
        world_mjcf(world, textured=True).count('name="thing_') for world in (sparse, dense(make_body, "Living", 1))
    ]
    assert counts[0] < counts[1]


def depth_m(model: mujoco.MjModel, data: mujoco.MjData, one: str, other: str) -> float:
    """Largest depth of two things in each other, by their geoms."""
    geoms = [[geom for geom in range(model.ngeom) if thing_of(model.geom(geom).name) == each] for each in (one, other)]
    return max(
        -mujoco.mj_geomDistance(model, data, first, second, 1.0, None) for first in geoms[0] for second in geoms[1]
    )


@pytest.mark.parametrize("kind", TYPES)
def test_things_are_in_nothing_else_and_stand_on_something(make_body: MakeBody, kind: str) -> None:
    model = model_of(dense(make_body, kind, 3))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    boxes: dict[str, list[tuple[np.ndarray, np.ndarray]]] = defaultdict(list)
    for geom in range(model.ngeom):
        thing = thing_of(model.geom(geom).name)
        if thing:
            boxes[thing].append(box_around(model, data, geom))
    things = {
        name: (np.min([low for low, _ in parts], axis=0), np.max([high for _, high in parts], axis=0))
        for name, parts in boxes.items()
    }
    colliding = np.flatnonzero(model.geom_contype)
    solids = {model.geom(int(geom)).name: box_around(model, data, int(geom)) for geom in colliding}
    names = list(things)
    for index, one in enumerate(names):
        others = [other for other in names[index + 1 :] if overlap_m(things[one], things[other]) > MOST_OVERLAP_M]
        # Boxes around things that are turned are too large.
        assert [other for other in others if depth_m(model, data, one, other) > MOST_OVERLAP_M] == [], one
        inside = [name for name, box in solids.items() if overlap_m(things[one], box) > MOST_OVERLAP_M]
        assert [name for name in inside if not is_open(name)] == [], one
    standing = [name for name in names if name.startswith("thing_") and not name.startswith("thing_shelf")]
    assert standing
    for name in standing:
        if "_coat_" not in name and "_towel_" not in name:
            low, high = things[name]
            below = np.array([*(low[:2] + high[:2]) / 2, low[2] + 0.004])
            geom = np.zeros(1, np.int32)
            groups = np.array([1, 1, 1, 1, 0, 0], np.uint8)
            assert -0.001 < mujoco.mj_ray(model, data, below, np.array([0, 0, -1.0]), groups, 1, -1, geom) < 0.012, name


def is_open(name: str) -> bool:
    """Whether a solid box stands for something one puts books into."""
    return name.startswith("Bookcases") and name.endswith(".body")


def test_a_large_world_s_bundle_is_small(make_body: MakeBody, tmp_path_factory: pytest.TempPathFactory) -> None:
    rooms = tuple((f"Room {index}", kind, 30.0) for index, kind in enumerate(TYPES[:6]))
    names = {"RoomNames": [name for name, _, _ in rooms]}
    arrangement = {"Name": "all", "TargetSet": names, "DesiredSpatialDensity": "Dense"}
    world = generate_world(make_body(rooms, furniture=[arrangement]), 1, 1, settle=False)
    folder = tmp_path_factory.mktemp("large") / "world"
    write_bundle(world, folder)
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < 3_000_000
