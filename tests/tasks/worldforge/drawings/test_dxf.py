"""Floor plans of CAD programs: drawn here with ezdxf, read as the drawings of SVG files are."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from ezdxf import filemanagement

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.world import DrawnSource, World
from prefect_robomaker.tasks.worldforge.drawings import dxf
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world
from prefect_robomaker.tasks.worldforge.drawings.dxf import read_dxf
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations

MM, INCHES = 4, 1
LEAF_MM = 900.0
OPEN, SHUT = 100.0, 0.0

Document = Any


class Plan:
    """A drawing of three rooms in millimetres, to which tests add doors."""

    def __init__(self, units: int = MM, per_mm: float = 1.0, version: str = "R2010") -> None:
        self.document: Document = filemanagement.new(version)
        self.document.header["$INSUNITS"] = units
        self.space: Any = self.document.modelspace()
        self.per_mm = per_mm
        self.room("Living room", (0, 0, 4500, 5000))
        self.room("Küche 101", (4600, 2600, 8000, 5000))
        self.room("Bedroom", (4600, 0, 8000, 2500))

    def at(self, *points: tuple[float, float]) -> list[tuple[float, float]]:
        return [(x * self.per_mm, y * self.per_mm) for x, y in points]

    def room(self, name: str, box: tuple[float, float, float, float], layer: str = "A-AREA") -> None:
        x0, y0, x1, y1 = box
        corners = self.at((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        draw = self.space.add_polyline2d if self.document.dxfversion == "AC1009" else self.space.add_lwpolyline
        draw(corners, close=True, dxfattribs={"layer": layer})
        self.text(name, (x0 + x1) / 2, (y0 + y1) / 2)

    def text(self, name: str, x: float, y: float) -> None:
        [at] = self.at((x, y))
        self.space.add_text(name, height=200 * self.per_mm).set_placement(at)

    def line(self, one: tuple[float, float], other: tuple[float, float], layer: str = "A-DOOR") -> None:
        self.space.add_line(*self.at(one, other), dxfattribs={"layer": layer})

    def arc(self, hinge: tuple[float, float], start: float, end: float, layer: str = "A-DOOR") -> None:
        [at] = self.at(hinge)
        self.space.add_arc(at, LEAF_MM * self.per_mm, start, end, dxfattribs={"layer": layer})

    def door_block(self, at: tuple[float, float], **attributes: object) -> None:
        """A leaf of 4 cm, its swing, and a frame, which says nothing of where the door is."""
        if "DOOR-90" not in self.document.blocks:
            block: Any = self.document.blocks.new("DOOR-90")
            for one, other in (((0, 0), (0, LEAF_MM)), ((40, 0), (40, LEAF_MM))):
                block.add_line(*self.at(one, other))
            block.add_arc((0, 0), LEAF_MM * self.per_mm, 0, 90)
            block.add_line(*self.at((-50, -50), (-50, 50)))
        [where] = self.at(at)
        self.space.add_blockref("DOOR-90", where, dxfattribs=attributes)

    def both_doors(self) -> None:
        """One as a block, one as lines on a layer."""
        self.door_block((4500, 3200), rotation=90)
        self.line((4600, 1000), (5500, 1000))
        self.arc((4600, 1000), 0, 90)

    def made(self, folder: Path, kind: str = "asc", settle: bool = False, **notes: object) -> World:
        path = folder / "flat.dxf"
        self.document.saveas(path, fmt=kind)
        return import_world(Source(path), DrawingNotes.model_validate(notes), 3, settle=settle)


def doors_are_drawn(world: World, south: float = 0.0) -> bool:
    """Whether both doors are where they were drawn, as far as the grid of 5 cm allows."""
    low = min(y for _, y in world.floorplan.footprint) + 0.1 - south
    found = [(each.rooms, each.start[1] - low, each.end[1] - low) for each in world.floorplan.passages[:2]]
    return all(
        rooms == ("Living room", other) and (start, end) == pytest.approx(drawn, abs=0.06)
        for (rooms, start, end), (other, drawn) in zip(
            found, [("Kuche 101", (3.2, 4.1)), ("Bedroom", (1.0, 1.9))], strict=True
        )
    )


def test_a_flat_of_a_cad_program_is_imported_furnished_and_proved(tmp_path: Path) -> None:
    plan = Plan()
    plan.both_doors()
    window: Any = plan.document.blocks.new("FENSTER")
    window.add_lwpolyline([(0, 0), (1400, 0), (1400, 200), (0, 200)], close=True)
    plan.space.add_blockref("FENSTER", (1000, 5000), dxfattribs={"layer": "0"})
    plan.space.add_linear_dim(base=(0, -800), p1=(0, 0), p2=(4500, 0), dxfattribs={"layer": "DIM"}).render()
    world = plan.made(tmp_path, settle=True)
    rooms = world.floorplan.rooms
    assert [(room.name, room.original_name, room.type) for room in rooms] == [
        ("Living room", None, "Living"), ("Kuche 101", "Küche 101", "Kitchen"), ("Bedroom", None, "Bedroom"),
    ]  # fmt: skip
    assert [room.floor_m2 for room in rooms] == pytest.approx([4.5 * 5, 3.4 * 2.4, 3.4 * 2.5])
    assert doors_are_drawn(world)
    assert [window.room for window in world.floorplan.windows] == ["Living room"]
    assert {wish.outcome for wish in world.floorplan.wishes} == {"satisfied"}
    assert len({item.room for item in world.furniture}) == 3
    assert world.checks is not None
    assert violations(world.checks) == []
    assert isinstance(world.source, DrawnSource)
    assert (world.source.form, world.source.metres_per_unit, world.source.outlines) == ("dxf", 0.001, "faces")
    assert world.source.left_out == ['1 DIMENSION on layer "DIM"']


@pytest.mark.parametrize(
    ("version", "kind", "units", "per_mm", "scale"),
    [
        ("R12", "asc", 0, 1.0, 0.001),
        ("R2000", "bin", INCHES, 1 / 25.4, None),
        ("R2018", "asc", MM, 0.001, 1.0),
    ],
)
def test_versions_and_units_draw_the_same_flat(
    version: str, kind: str, units: int, per_mm: float, scale: float | None, tmp_path: Path
) -> None:
    plan = Plan(units, per_mm, version)
    plan.both_doors()
    world = plan.made(tmp_path, kind, scale=scale)
    assert doors_are_drawn(world)
    assert isinstance(world.source, DrawnSource)
    assert world.source.metres_per_unit == (scale or 0.0254)


def test_doors_may_be_mirrored_in_blocks_of_blocks_bulges_lines_or_double(tmp_path: Path) -> None:
    plan = Plan()
    # Hinged at its north end: a mirrored block in a block that is no door itself.
    plan.door_block((0, 0), rotation=90, xscale=-1)
    mirrored = plan.space[-1]
    storey = plan.document.blocks.new("STOREY")
    plan.space.move_to_layout(mirrored, storey)
    plan.space.add_blockref("STOREY", (4500, 4100))
    # A leaf and its swing as one polyline with a bulge.
    quarter = 0.41421356237
    plan.space.add_lwpolyline(
        [(4600, 1000, 0), (5500, 1000, quarter), (4600, 1900, 0)], format="xyb", dxfattribs={"layer": "Doors shut"}
    )
    plan.room("Hall", (0, -2100, 8000, -100))
    for hinge, start, end, leaf in ((1000, 0, 90, 1000), (2800, 90, 180, 2800)):
        plan.line((leaf, -100), (leaf, 800))
        plan.arc((hinge, -100), start, end)
    plan.line((6000, -50), (7000, -50), layer="Opening")
    world = plan.made(tmp_path)
    assert doors_are_drawn(world, south=-2.1)
    percents = {each.rooms[1]: each.door.open_percent for each in world.floorplan.passages if each.door}
    assert (percents["Kuche 101"], percents["Bedroom"]) == (OPEN, SHUT)
    widths = {each.rooms: (each.kind, each.width_m) for each in world.floorplan.passages if "Hall" in each.rooms}
    assert widths == {("Living room", "Hall"): ("Doorway", 1.8), ("Bedroom", "Hall"): ("Opening", 1.0)}


def test_what_is_not_seen_counts_for_nothing(tmp_path: Path) -> None:
    plan = Plan()
    plan.both_doors()
    plan.document.layers.add("ROOMS OFF").off()
    plan.document.layers.add("ROOMS FROZEN").freeze()
    plan.room("Bath", (0, 0, 2000, 2000), layer="ROOMS OFF")
    plan.room("Bath", (0, 0, 2000, 2000), layer="ROOMS FROZEN")
    for text in plan.space.query('TEXT[text=="Bath"]'):
        plan.space.delete_entity(text)
    plan.document.layout().add_lwpolyline([(0, 0), (1, 0), (1, 1)], close=True, dxfattribs={"layer": "ROOMS"})
    # A tag of a room: its frame is no room, its attribute is a text.
    tag = plan.document.blocks.new("ROOM TAG")
    tag.add_lwpolyline([(-300, -100), (300, -100), (300, 100), (-300, 100)], close=True)
    plan.space.add_blockref("ROOM TAG", (6000, 500)).add_attrib("NAME", "B 12", (6000, 500))
    assert len(plan.made(tmp_path).floorplan.rooms) == 3


def _no_leaf(plan: Plan) -> None:
    plan.arc((4600, 1000), 0, 90)


def _both_ends(plan: Plan) -> None:
    plan.arc((4600, 1000), 0, 90)
    plan.line((4600, 1000), (5500, 1000))
    plan.line((4600, 1000), (4600, 1900))


def _corner(plan: Plan) -> None:
    """A swing without a leaf, at a corner of the bedroom."""
    plan.arc((4550, 2550), 180, 270)
    plan.room("Hall", (0, -2100, 8000, -100))
    plan.arc((4550, -50), 90, 180)


@pytest.mark.parametrize("swing", [_no_leaf, _both_ends])
def test_the_wall_decides_where_a_swing_alone_does_not_say(swing: Callable[[Plan], None], tmp_path: Path) -> None:
    plan = Plan()
    plan.door_block((4500, 3200), rotation=90)
    swing(plan)
    assert doors_are_drawn(plan.made(tmp_path))


def test_hatches_and_pictures_are_left_out_and_counted(tmp_path: Path) -> None:
    """They have an outline, too: a hatch that fills a room is no second room."""
    plan = Plan()
    plan.both_doors()
    for layer in ("A-AREA", "A-AREA", "A-DOOR"):
        hatch: Any = plan.space.add_hatch(dxfattribs={"layer": layer})
        hatch.paths.add_polyline_path(plan.at((0, 0), (4500, 0), (4500, 5000), (0, 5000)), is_closed=True)
    definition = plan.document.add_image_def("photo.png", (640, 480))
    plan.space.add_image(definition, (0, 0), (4500, 5000), dxfattribs={"layer": "ROOMS"})
    plan.space.add_wipeout(plan.at((0, 0), (4500, 5000)))
    world = plan.made(tmp_path)
    assert len(world.floorplan.rooms) == 3
    assert isinstance(world.source, DrawnSource)
    assert world.source.left_out == [
        '2 HATCH on layer "A-AREA"',
        '1 HATCH on layer "A-DOOR"',
        '1 IMAGE on layer "ROOMS"',
        '1 WIPEOUT on layer "0"',
    ]


def _astray(plan: Plan) -> None:
    plan.both_doors()
    plan.door_block((2000, 2000), layer="Doors")


def _curved(plan: Plan) -> None:
    plan.space.add_circle((10000, 0), 900, dxfattribs={"layer": "ROOMS"})


def _open(plan: Plan) -> None:
    plan.space.add_lwpolyline([(9000, 0), (9900, 0), (9900, 900)], dxfattribs={"layer": "Rooms"})


def _unknown(plan: Plan) -> None:
    plan.room("Xyzzy", (8100, 0, 9900, 5000), layer="ROOMS")


def _metres(plan: Plan) -> None:
    plan.document.header["$INSUNITS"] = 6


REFUSED: dict[str, tuple[Callable[[Plan], None], str]] = {
    "corner": (_corner, r'door ARC \w+ on layer "A-DOOR": both ends of its swing lie in walls; its leaf, drawn open'),
    "astray": (_astray, r'door INSERT \w+ of "DOOR-90" on layer "Doors" of 0.90 m: it lies in no wall'),
    "curved": (_curved, r'CIRCLE \w+ on layer "ROOMS": its outline has curves'),
    "open": (_open, r'LWPOLYLINE \w+ on layer "Rooms": its outline is not closed'),
    "unknown": (_unknown, r"room 'Xyzzy': what kind of room it is cannot be told from its name; say it with a text"),
    "metres": (_metres, r"at 1 m a unit its rooms are 8000 m wide together; say its scale with --scale"),
    "apart": (lambda plan: None, r"no door or opening leads from Living room to Kuche 101, Bedroom"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_taken_is_named(case: str, tmp_path: Path) -> None:
    change, expected = REFUSED[case]
    plan = Plan()
    change(plan)
    with pytest.raises(ConfigurationError, match=rf"^flat\.dxf: {expected}") as refused:
        plan.made(tmp_path)
    assert str(refused.value).count("\n") == 0


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"rooms: 3", "flat.dxf: this is not DXF"),
        (b"", "flat.dxf: this is not DXF"),
        (b"  0\nSECTION\n  2\nHEADER\n", "flat.dxf: the file is cut off; DXF ends with a line EOF"),
        (b"AC1032" + bytes(2000), "this is DWG; the same drawing, saved as DXF, would be right"),
        (b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n 10\nnowhere\n", "flat.dxf: "),
    ],
)
def test_files_that_are_no_drawings(content: bytes, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "flat.dxf"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError) as refused:
        import_world(Source(path), DrawingNotes(), 0, settle=False)
    assert expected in str(refused.value)


def test_an_entity_of_no_known_kind_is_left_out_and_counted(tmp_path: Path) -> None:
    """Such an entity may have no layer, nor any other of the usual members."""
    plan = Plan()
    plan.both_doors()
    plan.document.saveas(tmp_path / "flat.dxf")
    text = (tmp_path / "flat.dxf").read_text()
    head, entities = text.split("\nENTITIES\n")
    (tmp_path / "flat.dxf").write_text(f"{head}\nENTITIES\n{entities.replace('LWPOLYLINE', 'TELESCOPE', 1)}")

    made = read_dxf((tmp_path / "flat.dxf").read_bytes(), "flat.dxf")

    assert "1 TELESCOPE" in made.left_out
    assert made.shapes


def test_blocks_that_multiply_end_with_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dxf, "_MOST_ENTITIES", 1000)
    plan = Plan()
    inner = plan.document.blocks.new("B0")
    inner.add_line((0, 0), (1, 1))
    for depth in range(1, 8):
        block = plan.document.blocks.new(f"B{depth}")
        for _ in range(10):
            block.add_blockref(f"B{depth - 1}", (0, 0))
    plan.space.add_blockref("B7", (0, 0))
    with pytest.raises(ConfigurationError, match=r"more than 1,000 entities"):
        plan.made(tmp_path)


def test_without_ezdxf_the_error_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Plan()
    plan.document.saveas(tmp_path / "flat.dxf")
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(ConfigurationError, match="uv sync --frozen --inexact --extra dxf"):
        import_world(Source(tmp_path / "flat.dxf"), DrawingNotes(), 0, settle=False)
