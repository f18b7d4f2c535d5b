"""Contact sheets: every world on them, those with problems first."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.pictures.preview import render_preview
from prefect_robomaker.tasks.worldforge.viewer.contact_sheet import (
    Sheet,
    SheetFailure,
    SheetWorld,
    problems_first,
    sheet_page,
    sheet_png,
    sheet_world,
)

GONE = SheetWorld("world-3", "arn:3", "gone", problems=("no such object <worlds/3>",))


@pytest.fixture(scope="module")
def good(flat: World) -> SheetWorld:
    return sheet_world("world-1", "arn:1", flat, render_preview(flat))


def test_what_is_said_of_a_world_comes_from_the_world(flat: World, good: SheetWorld) -> None:
    assert good.rooms == ("Living Room", "Kitchen", "Bedroom", "Bath")
    assert good.verdict == "holds"
    assert good.area_m2 == pytest.approx(66, rel=0.05)
    assert flat.checks is not None
    checks = flat.checks.model_copy(update={"max_penetration_m": 0.02})
    broken = sheet_world("world-2", "arn:2", flat.model_copy(update={"checks": checks}), None)
    assert broken.verdict == "broken"
    assert "overlap" in broken.problems[0]
    assert sheet_world("world-4", "arn:4", flat.model_copy(update={"checks": None}), None).verdict == "not checked"


def test_a_small_picture_has_no_labels(flat: World, good: SheetWorld) -> None:
    """They would be 5 pixels high in a tile."""
    labelled, bare = (
        np.asarray(Image.open(io.BytesIO(each)).convert("RGB")).astype(int)
        for each in (good.preview or b"", render_preview(flat, named=False))
    )
    differs = np.abs(labelled - bare).max(axis=2) > 0
    assert 0.005 < differs.mean() < 0.1, "only the labels differ"
    assert labelled[differs].mean() > bare[differs].mean(), "labels are white"


def test_worlds_with_problems_come_first(good: SheetWorld) -> None:
    broken = replace(good, name="world-2", verdict="broken", problems=("bodies overlap",))
    sheet = Sheet(
        "Worlds", ("Completed",), problems_first([good, broken, GONE]), (SheetFailure(2, "Code", "why <not>"),)
    )
    assert [world.name for world in sheet.worlds] == ["world-3", "world-2", "world-1"]
    page = sheet_page(sheet)
    assert page.index("world-3") < page.index("world-2") < page.index("world-1")
    assert "no such object &lt;worlds/3&gt;" in page
    assert "<strong>2 not made</strong>: Code: why &lt;not&gt;" in page
    assert "robomaker world view arn:1" in page
    assert page.count('src="data:image/jpeg') == 2


def test_the_picture_has_a_tile_for_every_world(good: SheetWorld) -> None:
    one = Image.open(io.BytesIO(sheet_png(Sheet("Worlds", ("Completed",), (good,)))))
    many = Image.open(io.BytesIO(sheet_png(Sheet("Worlds", ("Completed",), (good,) * 7))))
    assert many.width > 4 * 320
    assert many.height > one.height + 240
    tile = many.crop((20, 92, 340, 332)).tobytes()
    assert len(set(tile)) > 50
    assert many.crop((360, 92, 680, 332)).tobytes() == tile


def test_a_job_without_worlds_has_a_sheet_that_says_so() -> None:
    sheet = Sheet("Worlds", ("Failed",), ())
    assert "no worlds" in sheet_page(sheet)
    assert Image.open(io.BytesIO(sheet_png(sheet))).height > 50
