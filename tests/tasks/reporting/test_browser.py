import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import CHROMIUM, NEEDS_BROWSER, browsing
from PIL import Image, ImageStat

from prefect_robomaker.tasks.reporting import write_report

pytestmark = NEEDS_BROWSER


def _browse(page: Path, profile: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage",
        "--no-first-run", "--disable-background-networking", "--enable-logging=stderr", f"--user-data-dir={profile}",
        *options, page.as_uri(),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=90, check=True)


@pytest.fixture
def page(mixed_report: Any, tmp_path: Path) -> Path:
    return write_report(mixed_report, tmp_path / "report.html")


@pytest.mark.parametrize(
    ("theme", "width"),
    # Blink numbers the schemes: 0 dark, 1 light.
    [("1", 1280), ("0", 1280), ("1", 500)],
    ids=["light", "dark", "phone"],
)
def test_a_browser_shows_the_page_without_complaint(page: Path, tmp_path: Path, theme: str, width: int) -> None:
    picture = tmp_path / "page.png"
    browsed = _browse(
        page, tmp_path / "profile", f"--blink-settings=preferredColorScheme={theme}",
        f"--window-size={width},1600", f"--screenshot={picture}",
    )  # fmt: skip
    # Refused styles and scripts, broken references and exceptions all end up on the console.
    assert "CONSOLE" not in browsed.stderr
    with Image.open(picture) as opened:
        image = opened.convert("RGB")
    assert image.width == width
    brightness = ImageStat.Stat(image.convert("L"))
    assert brightness.mean[0] > 180 if theme == "1" else brightness.mean[0] < 70
    assert brightness.stddev[0] > 12
    assert len(image.resize((image.width // 2, 800)).getcolors(500_000) or []) > 500


def test_a_click_on_a_column_sorts_the_table_with_gaps_last(page: Path, tmp_path: Path) -> None:
    html = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page.read_text(encoding="utf-8"))
    click = "<script>document.querySelectorAll('.sortable th button')[3].click()</script>"
    page.write_text(html.replace("</body>", f"{click}</body>"), encoding="utf-8")
    document = _browse(page, tmp_path / "profile", "--dump-dom").stdout
    table = document[document.index('<table class="sortable stacks"') :]
    table = table[: table.index("</table>")]
    assert re.search(r'aria-sort="ascending"><button type="button">Distance', table)
    jobs = re.findall(r'<th scope="row"[^>]*><a [^>]*><span[^>]*>\d+</span> ([^<]+)</a>', table)
    assert jobs == ["sim-fail1", "sim-pass1", "sim-pass2", "sim-broken1", "sim-cancel1"]


@pytest.mark.parametrize("width", [400, 1200])
def test_no_table_has_to_be_scrolled_sideways(page: Path, tmp_path: Path, width: int) -> None:
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        tab.load(page.as_uri(), width)
        tables = "[...document.querySelectorAll('.scroll')]"
        assert (
            tab.evaluate(f"{tables}.filter(each => each.scrollWidth > each.clientWidth).map(each => each.outerHTML)")
            == []
        )
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
        assert tab.complaints == []
        tab.picture(tmp_path / f"report-{width}.png")
