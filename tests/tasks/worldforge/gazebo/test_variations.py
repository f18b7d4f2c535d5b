"""Variations of imported worlds: they differ in what was asked for, and are proved anew."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.gazebo_house import write_house

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.world import GazeboSource
from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, read_world
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.gazebo.variations import vary_imported
from prefect_robomaker.tasks.worldforge.generator import Move, Wanted
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bundle of the house, from (0, 0)."""
    folder = tmp_path_factory.mktemp("gazebo")
    import_gazebo_world(write_house(folder / "house"), Wishes(start=Start(0.0, 0.0)), folder / "bundle")
    return folder / "bundle"


def occupied_at(bundle: Path, x: float, y: float) -> bool:
    known = read_map(bundle / "map.yaml")
    assert known.occupied is not None
    size = known.resolution_m
    return bool(known.occupied[int((y - known.origin[1]) / size), int((x - known.origin[0]) / size)])


def test_a_moved_crate_is_elsewhere_in_model_map_and_plan_and_proved(house: Path, tmp_path: Path) -> None:
    before = content_hash(house)
    wanted = Wanted(moved={"crate": Move(0.3, 0.5, 90)}, light="night", friction={"floor": 0.25, "walls": 0.5})
    world = vary_imported(house, wanted, "arn:of:it", tmp_path / "varied")
    assert content_hash(house) == before
    assert read_world(tmp_path / "varied") == world
    assert world.checks is not None
    assert violations(world.checks) == []
    assert isinstance(world.source, GazeboSource)
    assert world.variation is not None
    assert (world.variation.of_content, world.variation.of_world) == (before, "arn:of:it")
    assert [(change.what, change.thing, change.before, change.after) for change in world.variation.changes] == [
        ("moved", "crate", "at (0.80, -1.50)", "moved by 0.3 m east, 0.5 m north, turned by 90 degrees"),
        ("friction", "floor", "1", "0.25"),
        ("friction", "walls", "1", "0.5"),
        ("light", "world", "day", "night"),
    ]
    [crate] = [item for item in world.furniture if item.id == "crate"]
    assert (crate.x, crate.y) == pytest.approx((1.1, -1.0), abs=0.01)
    assert (occupied_at(house, 0.8, -1.5), occupied_at(house, 1.1, -1.0)) == (True, False)
    assert (occupied_at(tmp_path / "varied", 0.8, -1.6), occupied_at(tmp_path / "varied", 1.1, -1.0)) == (False, True)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "varied" / "world.xml"))
    assert model.geom("floor.s0").friction.tolist() == pytest.approx([0.25, 0.005, 0.0001])
    assert model.geom("crate.s0").friction[0] == 1.0
    assert model.light("sun").diffuse.tolist() == pytest.approx([0.05, 0.06, 0.09])


def test_a_crate_that_is_moved_into_a_wall_breaks_guarantees(house: Path, tmp_path: Path) -> None:
    world = vary_imported(house, Wanted(moved={"crate": Move(0.0, -1.0)}), None, tmp_path / "varied")
    assert world.checks is not None
    assert any("overlap" in each for each in violations(world.checks))


def slides_m(bundle: Path, tilt: float) -> float:
    """Distance that the crate slides in half a second where down is tilted to the north by some radians."""
    model = mujoco.MjModel.from_xml_path(str(bundle / "world.xml"))
    model.opt.gravity[:] = 0.0, 9.81 * np.sin(tilt), -9.81 * np.cos(tilt)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.body("crate").xpos.copy()
    mujoco.mj_step(model, data, round(0.5 / model.opt.timestep))
    return float(data.body("crate").xpos[1] - before[1])


@pytest.mark.parametrize("friction", [{"crate": 0.05}, {"floor": 0.05}, {"*": 0.05}, {"*": 0.9, "crate": 0.05}])
def test_slippery_pieces_slide_as_far_as_their_friction_says(
    house: Path, tmp_path: Path, friction: dict[str, float]
) -> None:
    tilt = 0.2
    vary_imported(house, Wanted(friction=friction), None, tmp_path / "varied")
    assert slides_m(house, tilt) == pytest.approx(0.0, abs=0.01)
    expected = 9.81 * (np.sin(tilt) - 0.05 * np.cos(tilt)) * 0.5**2 / 2
    assert slides_m(tmp_path / "varied", tilt) == pytest.approx(expected, rel=0.1)


def test_friction_that_is_set_later_counts_also_in_a_variation_of_a_variation(house: Path, tmp_path: Path) -> None:
    vary_imported(house, Wanted(friction={"*": 0.05}), None, tmp_path / "ice")
    vary_imported(tmp_path / "ice", Wanted(friction={"crate": 0.9}), None, tmp_path / "held")
    assert slides_m(tmp_path / "ice", 0.2) > 0.1
    assert slides_m(tmp_path / "held", 0.2) == pytest.approx(0.0, abs=0.01)


def test_pieces_may_be_gone_and_the_day_comes_back(house: Path, tmp_path: Path) -> None:
    dark = vary_imported(house, Wanted(removed=["shelf", "crate"], light="evening"), None, tmp_path / "dark")
    assert {"shelf", "crate"} & {item.id for item in dark.furniture} == set()
    assert not occupied_at(tmp_path / "dark", -1.8, 2.0)
    vary_imported(tmp_path / "dark", Wanted(light="day"), None, tmp_path / "day")
    skies = [
        next(line.strip() for line in (folder / "world.xml").read_text().splitlines() if 'name="sky"' in line)
        for folder in (house, tmp_path / "dark", tmp_path / "day")
    ]
    assert skies[1] != skies[0].replace(" />", "/>")
    assert skies[2].replace(" />", "/>") == skies[0].replace(" />", "/>")


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (Wanted(moved={"crat": Move(0, 1)}), r"crat: there is no such loose body; did you mean crate\?"),
        (Wanted(moved={"shelf": Move(0, 1)}), "shelf: there is no such loose body; there are crate"),
        (Wanted(removed=["tabel"]), "tabel: there is no such piece; "),
        (Wanted(friction={"crate": 11.0}), "friction of crate: 11; a number from 0 to 10 would be right"),
        (Wanted(friction={"crat": 1.0}), r"crat: there is no such piece; did you mean crate\?"),
        (Wanted(doors={"door_leaf": 50.0}), "door door_leaf: doors of worlds that were imported"),
        (Wanted(light="day"), "nothing would differ: the world's light is day already"),
    ],
)
def test_what_cannot_be_varied_is_refused_in_words(house: Path, tmp_path: Path, wanted: Wanted, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        vary_imported(house, wanted, None, tmp_path / "varied")
    assert not (tmp_path / "varied").exists()
