"""The page that shows a world: whole in one file, and drawn by a real browser."""

import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import NEEDS_BROWSER, Page, browsing
from numpy.typing import NDArray
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.viewer import viewer_page as page_module
from prefect_robomaker.tasks.worldforge.viewer.viewer_page import viewer_page

NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"
SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Draws without a graphics card."""


@pytest.fixture(scope="module")
def html(flat: World, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("bundle") / "world"
    write_bundle(flat, folder)
    return viewer_page(folder, "Flat </script><b>1")


def shot(page: Page, folder: Path) -> Image.Image:
    with Image.open(page.picture(folder / "page.png")) as opened:
        return opened.convert("RGB")


def colors(picture: Image.Image) -> int:
    """How many colours there are between the panels."""
    return len(picture.crop((100, 150, 500, 370)).getcolors(1_000_000) or [])


def state(page: Page) -> str:
    """Returns the page's word for its picture: `drawn`, `failed`, or not yet known."""
    return page.evaluate("document.body?.dataset.state") or ""


def test_the_page_fetches_nothing_and_escapes_names(html: str) -> None:
    assert "Flat &lt;/script&gt;&lt;b&gt;1" in html
    assert "<b>1" not in html
    assert not re.search(r'(?:src|href)="', html)
    assert "default-src &#39;none&#39;" in html


def test_pictures_come_from_the_page_alone(html: str) -> None:
    """three.js takes pictures out of the GLB by addresses inside the page; no other address is allowed."""
    assert "img-src data: blob:;" in html
    assert "connect-src" not in html[: html.index("</head>")]


def test_a_library_that_is_packed_otherwise_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("viewer.html.template", "<script>other</script>")
    monkeypatch.setattr(page_module.resources, "get_bytes", lambda _: packed.getvalue())
    page_module.three_js.cache_clear()
    with pytest.raises(RuntimeError, match=r"viewer\.html\.template: has no three\.js"):
        page_module.three_js()


@pytest.mark.deep
@NEEDS_BROWSER
def test_a_browser_draws_the_world_turns_it_and_says_when_it_cannot(html: str, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(html, encoding="utf-8")
    with browsing(tmp_path / "profile", *SOFTWARE_GL, "--blink-settings=preferredColorScheme=1") as browser:
        with browser.page() as page:
            page.load(file.as_uri(), 600, 460)
            page.wait(lambda page: state(page) == "drawn", "the world")
            still = shot(page, tmp_path)
            assert colors(still) > 2000
            # Refused scripts, shaders that do not compile, exceptions; taking a picture makes the driver wait.
            assert [each for each in page.complaints if "GPU stall due to ReadPixels" not in each] == []
            turns(page, still, tmp_path)
            names_rooms_and_obeys_its_controls(page)

        with browser.page() as page:
            page.send("Page.enable")
            page.send("Page.addScriptToEvaluateOnNewDocument", source=NO_WEBGL)
            page.load(file.as_uri(), 600, 460)
            page.wait(lambda page: state(page) == "failed", "the problem")
            problem = page.evaluate("document.querySelector('section#problem[role=alert]').innerText")
            assert "WebGL 2 is missing" in problem


@pytest.mark.deep
@NEEDS_BROWSER
@pytest.mark.parametrize(("width", "height"), [(400, 800), (1280, 720)])
def test_no_panel_covers_the_building(html: str, width: int, height: int, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(html, encoding="utf-8")
    light = "--blink-settings=preferredColorScheme=1"
    with browsing(tmp_path / "profile", *SOFTWARE_GL, light) as browser, browser.page() as page:
        page.load(file.as_uri(), width, height)
        page.wait(lambda page: state(page) == "drawn", "the world")
        page.evaluate(key("n"))
        for pressed in ("0", "ArrowLeft", "ArrowLeft", "ArrowDown", "t", "ArrowRight"):
            page.evaluate(key(pressed))
            panels = page.evaluate(PANELS)
            building = built(page, tmp_path)
            assert building.any(), "the building is in the picture"
            for left, top, right, bottom in panels:
                assert not building[top:bottom, left:right].any(), (pressed, left, top, right, bottom)
            # The free part is used: the building is not far away.
            rows, columns = np.nonzero(building)
            assert np.ptp(columns) > 0.3 * width or np.ptp(rows) > 0.3 * height


PANELS = """[...document.querySelectorAll('header, nav')].map((panel) => panel.getBoundingClientRect())
    .map((box) => [box.left, box.top, box.right, box.bottom].map(Math.round))"""
HIDE = "document.querySelectorAll('header, nav').forEach((panel) => (panel.style.visibility = '{}'))"


def key(name: str) -> str:
    return f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{name}', bubbles: true}}))"


def built(page: Page, folder: Path) -> NDArray[np.bool_]:
    """Pixels of the building, also those below the panels: all that has not the colour of the ground."""
    page.evaluate(HIDE.format("hidden"))
    picture = np.asarray(shot(page, folder)).astype(int)
    page.evaluate(HIDE.format(""))
    return np.abs(picture - picture[0, -1]).max(axis=2) > 12


def names_rooms_and_obeys_its_controls(page: Page) -> None:
    # In one step, as the page draws at most once in a step.
    press = "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'c', bubbles: true}));"
    page.evaluate(f"{press} const c = document.getElementById('cut'); c.value = 1; c.dispatchEvent(new Event('input'))")
    document = page.evaluate("document.documentElement.outerHTML")
    for room in ("Living Room", "Kitchen", "Bedroom", "Bath"):
        assert f">{room}<small>" in document
        assert f"<button>{room}</button>" in document
    assert re.search(r'id="ceiling"[^>]*aria-pressed="false"', document)
    assert ">1.00 m</output>" in document


def turns(page: Page, still: Image.Image, folder: Path) -> None:
    press = "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft'}))"
    page.evaluate(f"for (let i = 0; i < 6; i++) {press}")
    turned = shot(page, folder)
    assert colors(turned) > 2000
    assert still.tobytes() != turned.tobytes()
