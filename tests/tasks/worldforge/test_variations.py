"""Variations: one thing differs, it is named, and the world is proved again."""

from math import pi
from pathlib import Path

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.world import PassageKind, World
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.furniture.catalogue import styles_of
from prefect_robomaker.tasks.worldforge.generator import Move, Wanted, generate_world, vary
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations


@pytest.fixture(scope="module")
def world() -> World:
    """A flat of two rooms with a door between them."""
    return generate_world(WorldTemplateBody.model_validate({**BODY, "Version": "2"}), 1, 2)


def differing(one: World, other: World) -> set[str]:
    """Ids of furniture and doors that are not the same in both."""
    things = [
        {item.id: item for item in each.furniture} | {p.door.id: p.door for p in each.floorplan.passages if p.door}
        for each in (one, other)
    ]
    return {name for name in things[0].keys() | things[1].keys() if things[0].get(name) != things[1].get(name)}


def told(world: World) -> list[tuple[str, str, str, str]]:
    assert world.variation is not None
    return [(each.what, each.thing, each.before, each.after) for each in world.variation.changes]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("Doorway", "its doorway has none; doorways of"),
        ("Opening", "an opening joins its rooms, which has"),
    ],
)
def test_a_passage_without_a_door_is_told(world: World, kind: PassageKind, words: str) -> None:
    passages = [each.model_copy(update={"door": None, "kind": kind}) for each in world.floorplan.passages]
    without = world.model_copy(update={"floorplan": world.floorplan.model_copy(update={"passages": passages})})
    with pytest.raises(ConfigurationError, match=f"no door 'bedroom/living room'; {words}"):
        vary(without, Wanted(doors={"bedroom/living room": 0.0}), "c0ffee")


def test_a_shut_door_is_the_only_difference(world: World) -> None:
    shut = vary(world, Wanted(doors={"living room/bedroom": 0.0}), "c0ffee", "arn:of:it")
    assert differing(world, shut) == {"door-1"}
    assert told(shut) == [("door", "door-1", "100 % open", "0 % open")]
    assert shut.variation is not None
    assert (shut.variation.of_content, shut.variation.of_world) == ("c0ffee", "arn:of:it")
    assert shut.checks is not None
    assert violations(shut.checks) == [], "a robot can push it"
    assert len(shut.checks.closed_off_rooms) == 1
    by_id = vary(world, Wanted(doors={"door-1": 0.0}), "c0ffee", "arn:of:it")
    assert by_id == shut


def test_what_stands_on_a_piece_goes_with_it(world: World) -> None:
    item, under = next(
        (item, piece)
        for item in world.furniture
        for piece in world.furniture
        if item.movable
        and item.base_m > 0.2
        and not piece.movable
        and max(abs(piece.x - item.x), abs(piece.y - item.y)) < max(piece.width_m, piece.depth_m) / 2
        and abs(piece.base_m + piece.height_m - item.base_m) < 0.02
    )
    gone = vary(world, Wanted(removed=[under.id]), "c0ffee")
    assert differing(world, gone) >= {under.id, item.id}
    assert {(what, after) for what, _, _, after in told(gone)} == {("removed", "not there")}
    assert gone.checks is not None
    assert violations(gone.checks) == []

    moved = vary(world, Wanted(moved={under.id: Move(0.01, 0.02, 180)}), "c0ffee")
    assert differing(world, moved) == differing(world, gone)
    now = {each.id: each for each in moved.furniture}
    assert now[under.id].yaw == pytest.approx(under.yaw + pi)
    assert now[item.id].x - now[under.id].x == pytest.approx(under.x - item.x, abs=2e-4)
    assert now[under.id].y == pytest.approx(under.y + 0.02, abs=1e-4)


def test_what_stands_on_the_desk_does_not_go_with_the_chair_under_it(world: World) -> None:
    cup = next(item for item in world.furniture if item.movable and item.base_m > 0.4)
    template = next(item for item in world.furniture if not item.movable)
    style = styles_of("DeskChairs")[0]
    size = {"width_m": style.width_m, "depth_m": style.depth_m, "height_m": style.height_m}
    place = {"x": cup.x, "y": cup.y, "base_m": 0.0, "room": cup.room}
    look = {"id": "DeskChairs_9", "model_type": "DeskChairs", "style": style.name}
    chair = template.model_copy(update={**size, **place, **look})
    tucked = world.model_copy(update={"furniture": [*world.furniture, chair]})

    gone = vary(tucked, Wanted(removed=[chair.id]), "c0ffee")

    assert differing(tucked, gone) == {chair.id}
    assert gone.furniture == world.furniture


def test_a_variation_that_breaks_guarantees_says_so(world: World) -> None:
    piece = next(item for item in world.furniture if not item.movable)
    walled = vary(world, Wanted(moved={piece.id: Move(-piece.x, -piece.y)}), "c0ffee")
    assert walled.checks is not None
    assert "the cylinder of 1 m diameter at the origin is not clear" in violations(walled.checks)


def test_light_changes_pictures_alone(world: World, tmp_path: Path) -> None:
    dark = vary(world, Wanted(light="night"), "c0ffee")
    assert told(dark) == [("light", "world", "day", "night")]
    assert dark.checks == world.checks
    for name, each in (("day", world), ("night", dark)):
        write_bundle(each, tmp_path / name)
        assert read_world(tmp_path / name) == each
    bundles = [
        {path.name: path.read_bytes() for path in (tmp_path / name).rglob("*") if path.is_file()}
        for name in ("day", "night")
    ]
    files = {name for name in bundles[0] if bundles[0][name] != bundles[1][name]}
    assert files == {"world.json", "world.xml", "world_description.json"}
    bright, black = ((tmp_path / name / "world.xml").read_text().splitlines() for name in ("day", "night"))
    changed = {line.split()[0] for line in {*bright} ^ {*black}}
    assert changed <= {"<light", "<material", "<headlight", "<texture"}


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        (Wanted(doors={"door-7": 0.0}), "no door 'door-7'; did you mean 'door-1'?"),
        (Wanted(doors={"door-1": 100.0}), "door-1 is 100 % open already"),
        (Wanted(removed=["Throne_1"]), "no piece 'Throne_1'; "),
        (Wanted(light="day"), "nothing would differ: the world's light is day already"),
    ],
)
def test_what_cannot_differ_is_one_clear_error(world: World, wanted: Wanted, expected: str) -> None:
    with pytest.raises(ConfigurationError, match=expected.replace("?", r"\?")):
        vary(world, wanted, "c0ffee")


def test_fixed_pieces_turn_by_quarters_and_other_generators_worlds_stay(world: World) -> None:
    piece = next(item for item in world.furniture if not item.movable)
    with pytest.raises(ConfigurationError, match=f"{piece.id} stands fast, square to the walls"):
        vary(world, Wanted(moved={piece.id: Move(0, 0, 30)}), "c0ffee")
    with pytest.raises(ConfigurationError, match=r"generator 2\.1\.0 made the world"):
        vary(world.model_copy(update={"generator_version": "2.1.0"}), Wanted(light="night"), "c0ffee")
