"""The page that shows a world: whole in one file, and drawn by a real browser."""

import io
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from helpers.required_programs import needs
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.viewer import viewer_page as page_module
from prefect_robomaker.tasks.worldforge.viewer.viewer_page import viewer_page

BROWSER = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), "")
needs_browser = needs("chromium", BROWSER, "no Chromium on this machine")

pytestmark = pytest.mark.slow  # browsers without a graphics card draw slowly

NO_WEBGL = "<script>HTMLCanvasElement.prototype.getContext = () => null</script>"


@pytest.fixture(scope="module")
def html(flat: World, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("bundle") / "world"
    write_bundle(flat, folder)
    return viewer_page(folder, "Flat </script><b>1")


def browse(page: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [
        BROWSER, "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader", "--hide-scrollbars", "--disable-dev-shm-usage", "--no-first-run",
        "--disable-background-networking", "--enable-logging=stderr", f"--user-data-dir={page.parent / 'profile'}",
        "--virtual-time-budget=10000", "--window-size=900,700", *options, page.as_uri(),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)


def written(html: str, folder: Path, script: str = "", before: str = "") -> Path:
    """The page, with more scripts than its policy allows."""
    if script or before:
        html = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', before, html)
        html = html.replace("</body>", f"<script>{script}</script></body>")
    page = folder / "page.html"
    page.write_text(html, encoding="utf-8")
    return page


def shot(page: Path) -> Image.Image:
    picture = page.with_suffix(".png")
    browsed = browse(page, "--blink-settings=preferredColorScheme=1", f"--screenshot={picture}")
    assert "CONSOLE" not in browsed.stderr  # refused scripts, shaders that do not compile, exceptions
    with Image.open(picture) as opened:
        return opened.convert("RGB")


def colors(picture: Image.Image) -> int:
    """How many colours there are between the panels."""
    return len(picture.crop((150, 230, 750, 560)).getcolors(1_000_000) or [])


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


@needs_browser
def test_a_browser_draws_the_world(html: str, tmp_path: Path) -> None:
    picture = shot(written(html, tmp_path))
    assert colors(picture) > 3000


@needs_browser
def test_rooms_are_named_and_controls_do_what_they_say(html: str, tmp_path: Path) -> None:
    press = "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'c', bubbles: true}));"
    cut = "const c = document.getElementById('cut'); c.value = 1; c.dispatchEvent(new Event('input'));"
    document = browse(written(html, tmp_path, press + cut), "--dump-dom").stdout
    assert 'data-state="drawn"' in document
    for room in ("Living Room", "Kitchen", "Bedroom", "Bath"):
        assert f">{room}<small>" in document
        assert f"<button>{room}</button>" in document
    assert re.search(r'id="ceiling"[^>]*aria-pressed="false"', document)
    assert ">1.00 m</output>" in document


@needs_browser
@pytest.mark.deep
def test_turning_changes_the_picture(html: str, tmp_path: Path) -> None:
    turn = "for (let i = 0; i < 6; i++) document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft'}));"
    (tmp_path / "turned").mkdir()
    still, turned = shot(written(html, tmp_path)), shot(written(html, tmp_path / "turned", turn))
    assert colors(turned) > 3000
    assert still.tobytes() != turned.tobytes()


@needs_browser
def test_a_browser_without_webgl_says_so(html: str, tmp_path: Path) -> None:
    document = browse(written(html, tmp_path, before=NO_WEBGL), "--dump-dom").stdout
    assert 'data-state="failed"' in document
    assert re.search(r'<section id="problem" role="alert">', document)
    assert "WebGL 2 is missing" in document
