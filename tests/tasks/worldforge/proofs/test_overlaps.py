"""Overlaps of solid parts: what the proof finds is what another measure finds, and generated worlds have none."""

from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.solid_shapes import deep_overlaps

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, Furniture, World
from prefect_robomaker.tasks.worldforge.furniture.catalogue import LOOSE_TYPES, styles_of
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.proofs.checks import check_world, planned_site
from prefect_robomaker.tasks.worldforge.proofs.guarantees import MAX_PENETRATION_M, proof_lines, violations
from prefect_robomaker.tasks.worldforge.proofs.overlaps import find_overlaps

from ..conftest import ROOMS, MakeBody

FEW_SEEDS = range(1)
MANY_SEEDS = range(1, 11)


def piece(name: str, kind: str, style: str, x: float, y: float, **more: Any) -> Furniture:
    look = next(each for each in styles_of(kind) if each.name == style)
    size = {"width_m": look.width_m, "depth_m": look.depth_m, "height_m": look.height_m}
    return Furniture(id=name, model_type=kind, style=style, room="", x=x, y=y, **{"yaw": 0.0, **size, **more})


def with_pieces(world: World, *pieces: Furniture) -> World:
    return world.model_copy(update={"furniture": [*world.furniture, *pieces]})


def found_by_proof(mjcf: str, limit_m: float) -> dict[frozenset[str], float]:
    model = mujoco.MjModel.from_xml_string(mjcf)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {frozenset(each.parts): each.depth_m for each in find_overlaps(model, data) if each.depth_m > limit_m}


def test_a_chair_in_the_leg_of_its_table_is_found(flat: World) -> None:
    bare = flat.model_copy(update={"furniture": []})
    x, y = flat.floorplan.rooms[0].goal
    table = piece("table", "DiningTables", "four oak", x, y)
    # The table's front is 0.4 m off its middle, and its left leg begins 0.535 m to the side.
    chair = piece("chair", "DiningChairs", "upright oak", x + 0.4 + 0.235 - 0.13, y + 0.535 - 0.22 + 0.012, yaw=np.pi)
    world = with_pieces(bare, table, chair)
    checks = check_world(world, planned_site(world, mujoco.MjModel.from_xml_string(world_mjcf(world))))
    assert checks.max_penetration_m == pytest.approx(0.012, abs=1e-4)
    assert checks.penetrations == len(checks.penetrating or [])
    assert ("chair.seat", "table.leg-front-left") in [tuple(sorted(pair)) for pair in checks.penetrating or []]
    (broken,) = [each for each in violations(checks) if "overlap" in each]
    assert broken.startswith("parts overlap by 0.012 m, more than 0.005 m: ")
    (line,) = [each for each in proof_lines(world.model_copy(update={"checks": checks})) if "Penetr" in each.name]
    assert line.verdict == "broken"
    # MuJoCo sees nothing of it: neither of them moves.
    model = mujoco.MjModel.from_xml_string(world_mjcf(world))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_the_proof_finds_what_another_measure_finds(flat: World) -> None:
    dice = np.random.default_rng(4)
    clutter = []
    for number in range(40):
        kind = str(dice.choice([*MODEL_TYPES, *LOOSE_TYPES]))
        style = styles_of(kind)[0]
        loose = kind in LOOSE_TYPES
        yaw = float(dice.uniform(0, 6)) if loose else float(dice.integers(4)) * np.pi / 2
        place = dice.uniform(-3, 3, 2).tolist()
        made = piece(f"clutter_{number}", kind, style.name, *place, yaw=yaw)
        clutter.append(made.model_copy(update={"movable": loose}))
    mjcf = world_mjcf(with_pieces(flat, *clutter))
    proof, other = found_by_proof(mjcf, 0.004), deep_overlaps(mjcf, MAX_PENETRATION_M)
    assert len(other) > 60
    assert other.keys() <= proof.keys()
    assert found_by_proof(mjcf, 0.006).keys() <= other.keys()
    shallow = {pair: depth_m for pair, depth_m in other.items() if depth_m < 0.05}
    assert len(shallow) > 10
    assert {pair: proof[pair] for pair in shallow} == pytest.approx(shallow, rel=0.05, abs=1e-3)


def bodies(make_body: MakeBody) -> list[WorldTemplateBody]:
    """Templates that set many tables: dining rooms, everything everywhere, and doors."""
    everything = {
        "Name": "all", "TargetSet": {"RoomTypes": ["Living", "Kitchen", "Bedroom", "Bathroom"]},
        "DesiredSpatialDensity": "Dense", "SampleSet": {"ModelTypes": list(MODEL_TYPES)},
    }  # fmt: skip
    dining = (("Dining", "Dining", 24.0), ("Hall", "Hallway", 12.0), ("Kitchen", "Kitchen", 14.0))
    doors = make_body(dining).model_dump(mode="json", exclude_none=True) | {"Version": "2"}
    return [make_body(dining), make_body(ROOMS, furniture=[everything]), WorldTemplateBody.model_validate(doors)]


def overlaps_of_worlds(make_body: MakeBody, seeds: range) -> dict[str, dict[frozenset[str], float]]:
    """What overlaps in each world, by template and seed."""
    found = {}
    for number, body in enumerate(bodies(make_body)):
        for seed in seeds:
            try:
                world = generate_world(body, seed, seed + 1, settle=False)
            except WorldGenerationError:
                continue
            assert world.checks is not None
            assert (world.checks.penetrations, world.checks.penetrating) == (0, [])
            found[f"template {number}, seed {seed}"] = deep_overlaps(world_mjcf(world), MAX_PENETRATION_M)
    return found


def test_no_solid_parts_of_generated_worlds_overlap(make_body: MakeBody) -> None:
    found = overlaps_of_worlds(make_body, FEW_SEEDS)
    assert len(found) > len(FEW_SEEDS)
    assert {name: pairs for name, pairs in found.items() if pairs} == {}


@pytest.mark.endurance
def test_no_solid_parts_of_many_generated_worlds_overlap(make_body: MakeBody) -> None:
    found = overlaps_of_worlds(make_body, MANY_SEEDS)
    assert len(found) >= 25
    assert {name: pairs for name, pairs in found.items() if pairs} == {}
