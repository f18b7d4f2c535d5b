"""Drawings that no world can be made of: one error that names the shape and what would be right."""

from pathlib import Path

import pytest

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world

ROOMS = '<rect id="Kitchen" width="4" height="4"/><rect id="Living" x="4" width="4" height="4"/>'
DOOR = '<line class="door" id="d" x1="4" y1="1" x2="4" y2="2"/>'

CASES = {
    "no rooms": ("<circle r='3'/>", "0 rooms in it"),
    "slanted": (
        '<polygon id="Kitchen" points="0,0 4,1 4,4 0,4"/>',
        "'Kitchen': its edge from (0, 0) to (4, 1), in metres with y up from (0, 0) to (4, -1)",
    ),
    "curved": ('<path id="Kitchen" d="M0 0 H4 C5 1 5 2 4 4 H0 Z"/>', "'Kitchen': its outline has curves"),
    "open": ('<polyline class="room" id="Kitchen" points="0,0 4,0 4,4"/>', "'Kitchen': its outline is not closed"),
    "unknown kind": ('<rect class="room" id="Xyzzy" width="4" height="4"/>', "'Xyzzy': what kind of room"),
    "wrong type": ('<rect id="Kitchen" data-type="Pool" width="4" height="4"/>', "type is 'Pool'; one of Bedroom"),
    "control": ('<rect id="Kitchen &#155;31m" width="4" height="4"/>', "its name has control characters; remove them"),
    "overlap": (ROOMS.replace('x="4"', 'x="3"') + DOOR, "Kitchen and Living overlap by 4.00 m2"),
    "crossed": (
        '<polygon id="Bath" points="0,0 4,0 4,4 1,4 1,2 6,2 6,1 0,1"/>' + ROOMS.replace('y="', 'y="9'),
        "Bath: its outline crosses itself",
    ),
    "apart": (ROOMS, "no door or opening leads from Kitchen to Living"),
    "stray door": (ROOMS + DOOR.replace('"4"', '"2"'), "door d of 1.00 m: it lies in no wall"),
    "door across": (
        ROOMS + DOOR.replace('x1="4" y1="1"', 'x1="3.5" y1="2"').replace('x2="4"', 'x2="4.5"'),
        "door d of 1.00 m: it crosses the wall between Kitchen and Living; draw it along that wall",
    ),
    "tiny door": (ROOMS + DOOR.replace('y2="2"', 'y2="1.2"'), "it is narrower than 0.5 m"),
    "wide door": (ROOMS + DOOR.replace('y2="2"', 'y2="3.5"'), "it is wider than 2.4 m; is the scale right?"),
    "long door": (
        ROOMS.replace('height="4"', 'height="2"') + DOOR.replace('y1="1"', 'y1="0"'),
        "m between its corners",
    ),
    "two doors": (ROOMS + DOOR + DOOR.replace('"d"', '"e"'), "door e of 1.00 m between Kitchen and Living: another"),
    "ajar": (ROOMS + DOOR.replace("id=", 'data-open="wide" id='), "data-open is 'wide'; a number from 0 to 100"),
    "pixels": ('<g transform="scale(100)">' + ROOMS + DOOR + "</g>", "at 1 m a unit its rooms are 800 m wide"),
    "bad path": ('<path id="Kitchen" d="M0 0 L4"/>', '<path> "Kitchen" cannot be read'),
    "infinite": (ROOMS + DOOR.replace('y2="2"', 'y2="1e999"'), '<line> "d" has a coordinate that is not finite'),
    "text nowhere": (
        ROOMS + DOOR + '<text x="a" y="1">Hall</text>',
        "the text 'Hall' cannot be read: 'a' is no number",
    ),
    "text far": (ROOMS + DOOR + '<text x="1e999" y="1">Hall</text>', "the text 'Hall' has a coordinate that"),
    "deep": ("<g>" * 100_000 + "</g>" * 100_000, "more than 100 groups inside one another"),
    "traced": (f'<path id="Kitchen" d="M0 0 {"L1 2 " * 20_000}"/>', "0 rooms in it"),
    "long transform": (f'<g transform="{"rotate(1) " * 2000}"/>', "a transform has 20,000 characters"),
    "crowded": (ROOMS * 400 + '<text x="1" y="1">Hall</text>' * 7000, "too many to find which text names which room"),
    "bad transform": ('<g transform="rotate(x)"><rect id="Kitchen" width="4" height="4"/></g>', "transform rotate(x)"),
}


SEVERAL = {
    "rooms and openings": (
        '<polygon id="Kitchen" points="0,0 4,1 4,4 0,4"/><rect class="room" id="Xyzzy" width="4" height="4"/>'
        + DOOR.replace("id=", 'data-open="wide" id='),
        ("its edge from (0, 0)", "'Xyzzy': what kind of room", "data-open is 'wide'"),
    ),
    "doors": (
        ROOMS + DOOR.replace('"4"', '"2"') + DOOR.replace('"d"', '"e"').replace('y2="2"', 'y2="1.2"'),
        ("door d of 1.00 m: it lies in no wall", "door e of 0.20 m: it is narrower"),
    ),
    "overlaps": (
        ROOMS.replace('x="4"', 'x="3"') + '<rect id="Hall" x="6" width="4" height="4"/>',
        ("Kitchen and Living overlap by 4.00 m2", "Living and Hall overlap by 4.00 m2"),
    ),
}
"""Drawings with several mistakes, and what is said of each, in its order."""


def imported(path: Path, **notes: object) -> None:
    import_world(Source(path), DrawingNotes.model_validate(notes), 0, settle=False)


@pytest.mark.parametrize("case", SEVERAL)
def test_all_mistakes_of_a_drawing_are_told_together(case: str, tmp_path: Path) -> None:
    content, expected = SEVERAL[case]
    path = tmp_path / "plan.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{content}</svg>')
    with pytest.raises(ConfigurationError) as refused:
        imported(path)
    lines = str(refused.value).splitlines()
    assert all(part in line for part, line in zip(expected, lines, strict=True)), lines


@pytest.mark.parametrize("case", CASES)
def test_what_cannot_be_taken_is_named(case: str, tmp_path: Path) -> None:
    content, expected = CASES[case]
    path = tmp_path / "plan.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{content}</svg>')
    with pytest.raises(ConfigurationError) as refused:
        imported(path)
    assert expected in str(refused.value)
    assert str(refused.value).count("\n") == 0


def test_files_that_are_no_drawings(tmp_path: Path) -> None:
    for name, content, expected in (
        ("plan.svg", "rooms: 3", "plan.svg: this is not XML"),
        ("plan.svg", "<html/>", "its root is <html>"),
        ("plan.pdf", "%PDF", "a file that ends with .svg, .dxf, .yaml for a map"),
    ):
        (tmp_path / name).write_text(content)
        with pytest.raises(ConfigurationError, match=expected):
            imported(tmp_path / name)
    with pytest.raises(ConfigurationError, match=r"gone\.svg: it cannot be read: No such file"):
        imported(tmp_path / "gone.svg")


def test_notes_that_fit_no_room_or_paper(tmp_path: Path) -> None:
    path = tmp_path / "plan.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{ROOMS}{DOOR}</svg>')
    with pytest.raises(ConfigurationError, match="the notes name a room 'Pool'; the drawing has Kitchen, Living"):
        imported(path, rooms={"Pool": {"type": "Bathroom"}})
    meant = r"the notes name a room 'Kitchn'; did you mean 'Kitchen'\? The drawing has Kitchen, Living"
    with pytest.raises(ConfigurationError, match=meant):
        imported(path, rooms={"Kitchn": {"type": "Kitchen"}})
    with pytest.raises(ConfigurationError, match="scale 1:50: the drawing has no size on paper"):
        imported(path, scale="1:50")
