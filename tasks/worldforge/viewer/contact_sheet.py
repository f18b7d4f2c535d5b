"""Contact sheet of a generation job: a page with all its worlds, those with problems first."""

import base64
import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import jinja2
from markupsafe import Markup
from PIL import Image, ImageDraw, ImageFont

from ....schemas.wire.common import counted
from ....schemas.worlds.world import World
from ..floorplans.plan_signature import signature_of
from ..proofs.guarantees import violations

_FOLDER = Path(__file__).parent


def page(template: str, style: str, scripts: tuple[str, ...] = (), library: str = "", **values: Any) -> str:
    """Renders an HTML page from a template, with style sheet and scripts inlined.

    Args:
        template: File name of the template, which puts in `policy`, `style` and, if there is one, `script`.
        style: File name of the style sheet.
        scripts: File names of the scripts, which become one.
        library: A script that comes before them and makes pictures of parts of the page.
        values: Further values for the template; text is escaped.

    Returns:
        The document; its content security policy allows this style, these scripts and pictures inside the page.
    """
    css, script = _text(style), "".join(map(_text, scripts))
    allowed = " ".join(f"'{_digest(each)}'" for each in (library, script) if each) or "'none'"
    pictures = "data: blob:" if library else "data:"
    policy = (
        f"default-src 'none'; img-src {pictures}; style-src '{_digest(css)}'; script-src {allowed}; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        _environment()
        .get_template(template)
        .render(
            policy=policy,
            style=Markup(css),  # noqa: S704
            library=Markup(library),  # noqa: S704
            script=Markup(script),  # noqa: S704
            **values,
        )
    )


def json_island(value: Any) -> Markup:
    """Converts a value to JSON that is safe inside an HTML script element."""
    text = json.dumps(value, ensure_ascii=False).replace("<", "\\u003c")
    return Markup(text)  # noqa: S704


@cache
def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


Verdict = Literal["holds", "broken", "not checked", "gone"]

_TILE = (320, 240)
_CAPTION_PX = 92
_GAP_PX = 20
_HEAD_PX = 92
_MOST_COLUMNS = 5
_PAGE_PICTURE = (640, 480)
_ORDER: tuple[Verdict, ...] = ("gone", "broken", "not checked", "holds")
_WORDS = {"holds": "all guarantees hold", "broken": "broken", "not checked": "never checked", "gone": "cannot be read"}
_PAPER, _CARD, _INK, _MUTED, _EMPTY = "#eef0f3", "#ffffff", "#171b21", "#56606d", "#d9dde3"
_INKS = {"holds": "#00694d", "broken": "#a33f00", "not checked": "#6f5200", "gone": "#92336a"}


@dataclass(frozen=True)
class SheetWorld:
    """A world on a contact sheet (overview page of generated worlds)."""

    name: str
    arn: str
    verdict: Verdict
    rooms: tuple[str, ...] = ()
    """Names of a world's rooms, as in the template."""
    area_m2: float = 0.0
    pieces: int = 0
    missed_preferences: int = 0
    plan: str = ""
    """Key of the world's floor plan signature; empty if the world cannot be read."""
    problems: tuple[str, ...] = ()
    """Broken guarantees of a world, or the reason why the world cannot be read."""
    preview: bytes | None = None
    """Picture of a world from above (PNG); `None`: there is none."""

    @property
    def verdict_text(self) -> str:
        """Verdict on a world in words, as the contact sheet shows it: `2 guarantees broken`."""
        if self.verdict == "broken":
            return f"{counted(len(self.problems), 'guarantee')} broken"
        return _WORDS[self.verdict]


@dataclass(frozen=True)
class SheetFailure:
    """Number of worlds that failed for one reason, on a contact sheet."""

    count: int
    code: str
    reason: str


@dataclass(frozen=True)
class Sheet:
    """Content of a contact sheet, the overview page of generated worlds."""

    title: str
    lines: tuple[str, ...]
    """Lines about the generation job as a whole."""
    worlds: tuple[SheetWorld, ...]
    """Worlds of the contact sheet, in the order in which they are shown."""
    failures: tuple[SheetFailure, ...] = ()


def sheet_world(name: str, arn: str, world: World, preview: bytes | None) -> SheetWorld:
    """Makes the contact sheet's entry of a world; `preview` is its picture (PNG), or `None` without one."""
    broken = tuple(violations(world.checks)) if world.checks else ()
    plan = world.floorplan
    return SheetWorld(
        name=name,
        arn=arn,
        verdict="not checked" if world.checks is None else "broken" if broken else "holds",
        rooms=tuple(room.called for room in plan.rooms),
        area_m2=sum(room.floor_m2 for room in plan.rooms),
        pieces=len(world.furniture),
        plan=signature_of(plan).key,
        missed_preferences=sum(preference.outcome != "satisfied" for preference in (*plan.wishes, *world.wishes)),
        problems=broken,
        preview=preview,
    )


def problems_first(worlds: Sequence[SheetWorld]) -> tuple[SheetWorld, ...]:
    """Sorts worlds for the contact sheet: unreadable ones first, then invalid ones, then the others by plan."""
    numbers = plan_numbers(worlds)
    return tuple(sorted(worlds, key=lambda world: (_ORDER.index(world.verdict), numbers.get(world.plan, 0))))


def plan_numbers(worlds: Sequence[SheetWorld]) -> dict[str, int]:
    """Numbers the different plans of worlds from 1, in the order of the worlds' names."""
    named = sorted(worlds, key=lambda world: (len(world.name), world.name))
    return {plan: number for number, plan in enumerate(dict.fromkeys(world.plan for world in named if world.plan), 1)}


def _plan_line(world: SheetWorld, numbers: dict[str, int]) -> str:
    return f"plan {numbers[world.plan]} of {len(numbers)}" if world.plan else ""


def sheet_page(sheet: Sheet) -> str:
    """Renders the contact sheet as a self-contained HTML page."""
    numbers = plan_numbers(sheet.worlds)
    worlds = [
        {"world": world, "picture": _inline(world.preview), "plan": _plan_line(world, numbers)}
        for world in sheet.worlds
    ]
    return page("contact_sheet.html.j2", "contact_sheet.css", sheet=sheet, worlds=worlds)


def sheet_png(sheet: Sheet) -> bytes:
    """Renders the contact sheet as one picture (PNG).

    Returns the content of the file; nothing is written.
    """
    columns = max(1, min(_MOST_COLUMNS, len(sheet.worlds)))
    rows = -(-len(sheet.worlds) // columns)
    width, height = _TILE
    card = (width + _GAP_PX, height + _CAPTION_PX + _GAP_PX)
    head = [*sheet.lines, *(f"{each.count} failed: {each.code}: {each.reason}" for each in sheet.failures)]
    top = _HEAD_PX + 20 * max(0, len(head) - 1)
    size = (max(columns * card[0] + _GAP_PX, 2 * width), top + rows * card[1] + _GAP_PX)
    picture = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(picture)
    room = size[0] - 2 * _GAP_PX
    _write(draw, (_GAP_PX, 18), sheet.title, 24, _INK, room)
    for number, line in enumerate(head):
        ink = _MUTED if number < len(sheet.lines) else _INKS["gone"]
        _write(draw, (_GAP_PX, 54 + 20 * number), line, 14, ink, room)
    numbers = plan_numbers(sheet.worlds)
    for number, world in enumerate(sheet.worlds):
        row, column = divmod(number, columns)
        place = (_GAP_PX + column * card[0], top + row * card[1])
        _tile(picture, draw, world, _plan_line(world, numbers), place)
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    return buffer.getvalue()


def _tile(
    picture: Image.Image, draw: ImageDraw.ImageDraw, world: SheetWorld, plan: str, place: tuple[int, int]
) -> None:
    (x, y), (width, height) = place, _TILE
    draw.rectangle((x, y, x + width - 1, y + height + _CAPTION_PX - 1), fill=_CARD)
    if world.preview:
        with Image.open(io.BytesIO(world.preview)) as opened:
            picture.paste(opened.convert("RGB").resize(_TILE, Image.Resampling.LANCZOS), place)
    else:
        draw.rectangle((x, y, x + width - 1, y + height - 1), fill=_EMPTY)
        _write(draw, (x + 12, y + height // 2 - 8), "no picture", 14, _MUTED, width - 24)
    room = width - 24
    ink = _INKS[world.verdict]
    draw.rectangle((x, y + height, x + width - 1, y + height + 3), fill=ink)
    _write(draw, (x + 12, y + height + 10), f"{world.name}, {plan}" if plan else world.name, 15, _INK, room)
    _write(draw, (x + 12, y + height + 31), _rooms(world), 12, _MUTED, room)
    _write(draw, (x + 12, y + height + 49), _measures(world), 12, _MUTED, room)
    _write(draw, (x + 12, y + height + 67), _verdict_line(world), 13, ink, room)


def _rooms(world: SheetWorld) -> str:
    return f"{counted(len(world.rooms), 'room')}: {', '.join(world.rooms)}" if world.rooms else ""


def _measures(world: SheetWorld) -> str:
    if not world.rooms:
        return ""
    return f"{world.area_m2:.0f} m², {world.pieces} things, wishes missed: {world.missed_preferences}"


def _verdict_line(world: SheetWorld) -> str:
    return f"{world.verdict_text}: {world.problems[0]}" if world.problems else world.verdict_text


def _write(draw: ImageDraw.ImageDraw, place: tuple[int, int], text: str, size_px: int, ink: str, room_px: int) -> None:
    """Writes one line of text into the picture, cut off at the given width."""
    font = ImageFont.load_default(size_px)
    text = " ".join(text.split())
    if draw.textlength(text, font=font) > room_px:
        while text and draw.textlength(f"{text}…", font=font) > room_px:
            text = text[:-1]
        text = f"{text}…"
    # Pillow's own font has no raised 2.
    (x, y), small = place, ImageFont.load_default(round(0.65 * size_px))
    for index, part in enumerate(text.split("²")):
        if index:
            draw.text((x, y), "2", fill=ink, font=small)
            x += draw.textlength("2", font=small)
        draw.text((x, y), part, fill=ink, font=font)
        x += draw.textlength(part, font=font)


def _inline(preview: bytes | None) -> str | None:
    """Encodes a preview as a data URL: JPEG, a tenth of the PNG's size; `None` stays `None`."""
    if preview is None:
        return None
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(preview)) as opened:
        opened.convert("RGB").resize(_PAGE_PICTURE, Image.Resampling.LANCZOS).save(buffer, "JPEG", quality=82)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
