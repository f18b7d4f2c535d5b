"""Proofs measure what is simulated: each sabotage of a bundle breaks its guarantee, at its place."""

import json
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.gazebo_house import write_house

from prefect_robomaker.schemas.worlds.world import Fault
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world
from prefect_robomaker.tasks.worldforge.bundle.proving import prove
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.proofs.guarantees import proof_lines, violations
from prefect_robomaker.tasks.worldforge.seeds import GENERATOR_VERSION

FLAT, OTHER_INTERIOR = "generation_82856b0yq33y_world_1", "generation_82856b0yq33y_world_2"

Sabotage = Callable[[Path], None]


@pytest.fixture
def flat_bundle(bundles: dict[str, Path], tmp_path: Path) -> Path:
    """A flat with half-open doors, that a test may spoil."""
    return shutil.copytree(bundles[FLAT], tmp_path / "flat")


def proven(folder: Path) -> tuple[list[Fault], list[str]]:
    """Faults that the proof finds, and the sentences of all that is broken."""
    checks = prove(read_world(folder), folder)
    assert checks.faults is not None
    return checks.faults, violations(checks)


def geom(tag: str, **changes: str) -> Sabotage:
    """Changes the first geom, joint or body whose name begins so."""
    return lambda folder: _edit(folder, lambda root: _named(root, tag).attrib.update(changes))


def without(tag: str) -> Sabotage:
    """Removes it."""

    def remove(root: ET.Element) -> None:
        found = _named(root, tag)
        next(each for each in root.iter() if found in list(each)).remove(found)

    return lambda folder: _edit(folder, remove)


def moved(tag: str, *by_m: float) -> Sabotage:
    """Moves it by as many metres."""

    def move(root: ET.Element) -> None:
        found = _named(root, tag)
        place = [float(word) for word in found.get("pos", "0 0 0").split()]
        found.set("pos", " ".join(str(a + b) for a, b in zip(place, by_m, strict=True)))

    return lambda folder: _edit(folder, move)


def scaled(tag: str, factor: float) -> Sabotage:
    """Makes it larger or smaller."""

    def scale(root: ET.Element) -> None:
        found = _named(root, tag)
        found.set("size", " ".join(str(factor * float(word)) for word in found.attrib["size"].split()))

    return lambda folder: _edit(folder, scale)


def added(text: str) -> Sabotage:
    """Puts an element into the world body."""

    def add(root: ET.Element) -> None:
        (body,) = root.findall("worldbody")
        body.append(ET.fromstring(text))

    return lambda folder: _edit(folder, add)


def inertial(text: str) -> Sabotage:
    """Gives the first door an inertia."""
    return lambda folder: _edit(folder, lambda root: _named(root, "body:door-1").insert(0, ET.fromstring(text)))


def welded(folder: Path) -> None:
    """Holds the first door where it is."""
    weld = '<equality><weld body1="door-1"/></equality>'
    _edit(folder, lambda root: root.append(ET.fromstring(weld)))


def _edit(folder: Path, change: Callable[[ET.Element], None]) -> None:
    tree = ET.parse(folder / "world.xml")
    change(tree.getroot())
    tree.write(folder / "world.xml")


def _named(root: ET.Element, tag: str) -> ET.Element:
    kind, name = tag.split(":")
    return next(each for each in root.iter(kind) if each.get("name", "").startswith(name))


def in_doorway(folder: Path) -> None:
    """A box fills the doorway of a room that has no other."""
    for passage in read_world(folder).floorplan.passages:
        if "Bath" in passage.rooms:
            x, y = ((a + b) / 2 for a, b in zip(passage.start, passage.end, strict=True))
            added(f'<geom name="box" type="box" pos="{x} {y} 0.3" size="0.4 0.4 0.3"/>')(folder)


def map_cells(change: Callable[[bytearray, int, int], None]) -> Sabotage:
    """Changes pixels of the map, given those, their width and the place of the first one."""

    def spoil(folder: Path) -> None:
        content = bytearray((folder / "map.pgm").read_bytes())
        head = re.match(rb"P5\s+(\d+)\s+(\d+)\s+255\s", bytes(content))
        assert head is not None
        change(content, int(head[1]), head.end())
        (folder / "map.pgm").write_bytes(content)

    return spoil


def all_free(pixels: bytearray, _: int, first: int) -> None:
    pixels[first:] = pixels[first:].replace(b"\x00", b"\xfe")


def one_freed(pixels: bytearray, _: int, first: int) -> None:
    pixels[pixels.index(0, first)] = 254


def one_filled(pixels: bytearray, width: int, first: int) -> None:
    """A cell of free floor with free floor all around."""
    middle = pixels.index(bytes([254]) * 20, first + width * (len(pixels) // width // 2)) + 10
    pixels[middle] = 0


def one_forgotten(pixels: bytearray, width: int, first: int) -> None:
    pixels[pixels.index(bytes([254]) * 20, first + width * 10) + 10] = 205


def grown(pixels: bytearray, _: int, first: int) -> None:
    pixels[first] = 254


def text(name: str, old: str, new: str) -> Sabotage:
    """Replaces the first place of a text in a file."""

    def spoil(folder: Path) -> None:
        content = (folder / name).read_text()
        assert old in content
        (folder / name).write_text(content.replace(old, new, 1))

    return spoil


def described(change: Callable[[dict[str, Any]], None]) -> Sabotage:
    """Changes what `world.json` says."""

    def spoil(folder: Path) -> None:
        document = json.loads((folder / "world.json").read_text())
        change(document)
        (folder / "world.json").write_text(json.dumps(document))

    return spoil


def goal_outside(document: dict[str, Any]) -> None:
    document["floorplan"]["rooms"][0]["goal"] = [50.0, 50.0]


def piece_elsewhere(document: dict[str, Any]) -> None:
    document["furniture"][0]["x"] += 0.3


def hinge_elsewhere(document: dict[str, Any]) -> None:
    next(each for each in document["floorplan"]["passages"] if each["door"])["door"]["hinge"][0] += 0.1


OFF = {"contype": "0", "conaffinity": "0"}
CHEAP: dict[str, tuple[Sabotage, set[str], str]] = {
    "a box in a doorway": (in_doorway, {"ways", "reach", "parts", "map", "lidar"}, "world.xml has box"),
    "a wall that robots pass": (geom("geom:wall_1", **OFF), {"parts", "lidar"}, "wall_1"),
    "a door turned": (geom("body:door-1", euler="0 0 0.1"), {"doors"}, "door-1.leaf is not as world.json has it"),
    "a map that is all free": (map_cells(all_free), {"map"}, "map.pgm shows nothing where"),
    "a cell filled": (map_cells(one_filled), {"map"}, "shows an obstacle where nothing stands, 1 cells"),
    "a cup in the air": (moved("body:Cup", 0, 0, 0.5), {"rest", "parts"}, "Cup_1 moves"),
    "a lower ceiling described": (
        text("world_description.json", '"ceilingHeight":2.7', '"ceilingHeight":2.6'), {"description"},
        "ceilingHeight is 2.6, not 2.7",
    ),
}  # fmt: skip
"""Sabotages, the guarantees that have to break, and words of a sentence."""

DEEP: dict[str, tuple[Sabotage, set[str], str]] = {
    "a wall away": (without("geom:wall_5"), {"parts"}, "wall_5"),
    "a wall moved": (moved("geom:wall_5", 0.3, 0.3, 0.0), {"parts", "map"}, "wall_5"),
    "a wall scaled": (scaled("geom:wall_5", 0.9), {"parts"}, "wall_5"),
    "a wall with bits of its own": (geom("geom:wall_5", contype="2", conaffinity="2"), {"parts"}, "wall_5"),
    "a floor away": (without("geom:floor_3"), {"parts", "map"}, "floor_3, is missing"),
    "a floor sunk": (moved("geom:floor_3", 0, 0, -0.04), {"parts"}, "floor_3"),
    "a part scaled": (scaled("geom:Sofas_1.filling", 1.2), {"parts"}, "Sofas_1.filling"),
    "a part moved 3 mm": (moved("geom:Sofas_1.filling", 0.003, 0, 0), {"parts"}, "Sofas_1.filling"),
    "a part away": (without("geom:Sofas_1.filling"), {"parts"}, "Sofas_1.filling is missing"),
    "a part that robots pass": (geom("geom:Sofas_1.filling", **OFF), {"parts"}, "Sofas_1.filling is missing or"),
    "a part of another shape": (geom("geom:Sofas_1.filling", type="ellipsoid"), {"parts"}, "Sofas_1.filling"),
    "a part turned": (geom("geom:Sofas_1.filling", quat="0.98 0 0 0.2"), {"parts"}, "Sofas_1.filling"),
    "a part too many": (added('<geom name="Sofas_1.more" size="0.1" pos="0 0 2"/>'), {"parts"}, "Sofas_1.more"),
    "a box at the origin": (
        added('<geom name="box" type="box" pos="0.3 0 0.2" size="0.1 0.1 0.2"/>'), {"parts", "map", "lidar"},
        "the cylinder of 1 m diameter at the origin is not clear",
    ),
    "a nameless box": (added('<geom type="box" pos="0 1 1.5" size="0.1 0.1 0.1"/>'), {"parts"}, "without a name"),
    "a loose box": (
        added('<body name="box" pos="0 1 0.1"><freejoint/><geom size="0.1"/></body>'), {"parts", "map"}, "box",
    ),
    "a door's hinge moved": (moved("body:door-1", 0.1, 0.1, 0.0), {"doors"}, "door-1 hangs at"),
    "a door that opens half": (geom("joint:door-1", range="0 0.7"), {"doors"}, "door-1 opens from 0.00 to 0.70"),
    "a door that falls": (geom("joint:door-1", axis="1 0 0"), {"doors"}, "door-1 turns about another axis"),
    "a door ajar otherwise": (geom("joint:door-1", ref="0.2"), {"doors"}, "door-1"),
    "a door that is jammed": (geom("joint:door-1", damping="1000000"), {"doors"}, "damping is 1e+06, not 0.8"),
    "a door that sticks": (geom("joint:door-1", frictionloss="50"), {"doors"}, "frictionloss is 50, not 0.4"),
    "a door as of lead": (geom("joint:door-1", armature="500"), {"doors"}, "armature is 500, not 0"),
    "a door on a spring": (geom("joint:door-1", stiffness="90"), {"doors"}, "stiffness is 90, not 0"),
    "a leaf of lead": (geom("geom:door-1.leaf", mass="900"), {"doors"}, "mass is 900"),
    "a door with another inertia": (
        inertial('<inertial pos="0.4 0 1" mass="22.4" diaginertia="900 900 900"/>'), {"doors"}, "its inertia is 9",
    ),
    "a door that is welded": (
        welded, {"parts"}, "world.xml has 1 constraints, motors and tendons",
    ),
    "a door that slides": (geom("joint:door-1", type="slide"), {"doors"}, "door-1 has no hinge"),
    "a leaf away": (without("geom:door-1.leaf"), {"doors"}, "door-1.leaf is missing"),
    "a hinge away": (without("joint:door-1"), {"doors"}, "door-1 has no hinge"),
    "a cup in a table": (moved("body:Cup", 0, 0, -0.02), {"parts", "overlaps"}, "overlap by"),
    "a cell freed": (map_cells(one_freed), {"map"}, "shows nothing where wall_"),
    "a cell forgotten": (map_cells(one_forgotten), {"map"}, "map.pgm does not know what is there, 1 cells"),
    "floor outside": (map_cells(grown), {"map"}, "shows floor where the world has none"),
    "a map that is moved": (text("map.yaml", "origin: [-", "origin: [-1"), {"map"}, "map.yaml says 'origin: [-1"),
    "a coarse map": (text("map.yaml", "0.05", "0.1"), {"map"}, "map.yaml says 'resolution: 0.1'"),
    "no map": (lambda folder: (folder / "map.pgm").unlink(), {"map"}, "map.pgm cannot be read"),
    "no description": (
        lambda folder: (folder / "world_description.json").unlink(), {"description"}, "cannot be read",
    ),
    "another plan": (text("floorplan.svg", "Bath", "Bar"), {"description"}, "floorplan.svg is not the plan"),
    "a goal outside": (described(goal_outside), {"reach", "description"}, "its goal is out of a robot's reach, at (50"),
    "a piece described elsewhere": (described(piece_elsewhere), {"parts", "description"}, "a face is 300 mm off"),
    "a hinge described elsewhere": (described(hinge_elsewhere), {"doors", "description"}, "hangs at"),
}  # fmt: skip


def spoiled(folder: Path, sabotage: tuple[Sabotage, set[str], str]) -> None:
    spoil, guarantees, words = sabotage
    spoil(folder)
    faults, broken = proven(folder)
    assert guarantees <= {fault.guarantee for fault in faults}, broken
    assert any(words in sentence for sentence in broken), broken


def test_an_untouched_bundle_is_proven(flat_bundle: Path) -> None:
    assert proven(flat_bundle) == ([], [])


@pytest.mark.parametrize("name", CHEAP)
def test_a_sabotage_is_noticed(flat_bundle: Path, name: str) -> None:
    spoiled(flat_bundle, CHEAP[name])


@pytest.mark.deep
@pytest.mark.parametrize("name", DEEP)
def test_each_sabotage_is_noticed(flat_bundle: Path, name: str) -> None:
    spoiled(flat_bundle, DEEP[name])


@pytest.mark.deep
@pytest.mark.parametrize("name", ["world.xml", "world.json", "map.pgm", "world_description.json", "floorplan.svg"])
def test_a_file_of_another_world_is_noticed(flat_bundle: Path, bundles: dict[str, Path], name: str) -> None:
    """The other one has the same plan."""
    shutil.copy(bundles[OTHER_INTERIOR] / name, flat_bundle / name)
    if name == "world.xml":  # it names meshes and pictures of its own
        for folder in ("textures", "meshes"):
            shutil.copytree(bundles[OTHER_INTERIOR] / folder, flat_bundle / folder, dirs_exist_ok=True)
    assert proven(flat_bundle)[1]


def test_what_is_broken_has_its_room_and_its_place(flat_bundle: Path) -> None:
    """The box is told where it stands, in the words of the command."""
    in_doorway(flat_bundle)
    world = read_world(flat_bundle)
    checks = prove(world, flat_bundle)
    doorway = next(each for each in world.floorplan.passages if "Bath" in each.rooms)
    x, y = ((a + b) / 2 for a, b in zip(doorway.start, doorway.end, strict=True))
    (box,) = [fault for fault in checks.faults or [] if "has box" in fault.said]
    assert box.at == pytest.approx((x, y), abs=1e-3)
    assert checks.reachable_cells["Bath"] == 0
    broken = {
        line.name for line in proof_lines(world.model_copy(update={"checks": checks})) if line.verdict == "broken"
    }
    assert {"Bath", "Model and world.json", "Map and model", "Lidar and map"} <= broken


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An imported house."""
    folder = tmp_path_factory.mktemp("proving")
    import_gazebo_world(write_house(folder / "house"), Wishes(start=Start(0.0, 0.0)), folder / "bundle")
    return folder / "bundle"


@pytest.mark.deep
def test_imported_worlds_are_proven_by_the_same_code(house: Path, tmp_path: Path) -> None:
    assert proven(house) == ([], [])
    table = next(item for item in read_world(house).furniture if not item.movable)
    spots = {
        "a box": (added('<geom name="box" type="box" pos="1 1 0.2" size="0.1 0.1 0.2"/>'), {"map", "lidar"}),
        "a cell": (map_cells(one_filled), {"map"}),
        "a box in the air": (moved(f"geom:{table.id}", 0.2, 0.0, 0.0), {"parts"}),
        "a part that robots pass": (geom(f"geom:{table.id}", **OFF), {"parts"}),
        "another description": (text("world_description.json", '"x":', '"x":1'), {"description"}),
    }
    for number, (name, (spoil, guarantees)) in enumerate(spots.items()):
        folder = shutil.copytree(house, tmp_path / str(number))
        spoil(folder)
        faults, broken = proven(folder)
        assert guarantees <= {fault.guarantee for fault in faults}, (name, broken)


def verdicts(folder: Path) -> dict[str, tuple[str, str]]:
    """Values and verdicts of all lines of a proof, by name."""
    world = read_world(folder)
    lines = proof_lines(world.model_copy(update={"checks": prove(world, folder)}))
    return {line.name: (line.value, line.verdict) for line in lines}


def test_a_world_that_names_an_earlier_generator_is_told_as_less_compared(tmp_path: Path) -> None:
    earlier = shutil.copytree(Path(__file__).parent / "generators" / "2.1.0", tmp_path / "earlier")
    (earlier / "floorplan.svg").write_text("")
    found = verdicts(earlier)
    assert found["Model and world.json"] == (
        "not compared: an earlier generator's parts are compared by outline only", "not measured",
    )  # fmt: skip
    assert found["world_description.json"] == (
        "not compared: an earlier generator's floor plan is not drawn again", "not measured",
    )  # fmt: skip


@pytest.mark.parametrize("piece", ["Cup_1", "Sofas_1"])
def test_a_world_that_names_generator_3_2_is_proven_by_outlines(flat_bundle: Path, piece: str) -> None:
    """The ears of its mugs stand 36 mm out of their outlines, and what is 4 cm elsewhere is still noticed."""
    text = (flat_bundle / "world.json").read_text().replace(f'"{GENERATOR_VERSION}"', '"3.2.0"')
    (flat_bundle / "world.json").write_text(text)
    world = read_world(flat_bundle)
    assert {"Cup", "Sofas"} <= {item.model_type for item in world.furniture}
    assert world.generator_version == "3.2.0"
    assert not [fault for fault in proven(flat_bundle)[0] if fault.guarantee == "parts"]
    _edit(flat_bundle, lambda root: _shift(root, piece, 0.04))
    told = [fault.said for fault in proven(flat_bundle)[0] if fault.guarantee == "parts"]
    assert told == [f"{piece} is not as world.json has it: a face is 40 mm off"]


def _shift(root: ET.Element, piece: str, by_m: float) -> None:
    """Moves a piece and all that is drawn of it to the east."""
    bodies = [body for body in root.iter("body") if body.get("name") == piece]
    for each in bodies or [geom for geom in root.iter("geom") if geom.get("name", "").startswith(f"{piece}.")]:
        x, y, z = map(float, each.attrib["pos"].split())
        each.set("pos", f"{x + by_m} {y} {z}")


@pytest.mark.parametrize("made_by", ["this generator", "an earlier one"])
def test_what_is_shown_and_what_is_proven_count_geoms_alike(flat_bundle: Path, made_by: str) -> None:
    folder = flat_bundle if made_by == "this generator" else Path(__file__).parent / "generators" / "2.1.0"
    world = read_world(folder)
    shown = {line.name: (line.value, line.verdict) for line in proof_lines(world)}["Geoms that collide"]
    count, verdict = verdicts(folder)["Geoms that collide"]
    assert verdict == ""
    if made_by == "this generator":
        assert shown == (count, "")
    else:
        assert shown == (
            "154, those for the eye among them, which an earlier generator counted as well",
            "not measured",
        )
        assert count == "72"


def test_an_imported_world_is_said_to_have_its_pieces_only_compared(house: Path) -> None:
    assert verdicts(house)["Model and world.json"] == (
        "the same pieces; floors, walls and other parts are not compared", "holds",
    )  # fmt: skip


def test_a_proof_is_no_part_of_the_stored_world(flat_bundle: Path) -> None:
    world = read_world(flat_bundle)
    checks = prove(world, flat_bundle)
    kept = json.loads((flat_bundle / "world.json").read_text())["checks"]
    assert {"faults", "not_compared"}.isdisjoint(kept)
    assert checks.geoms == kept["geoms"]
