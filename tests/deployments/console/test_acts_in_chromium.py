"""What visitors start, in Chromium: worlds from the form, a run from a text, its failed job once more."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, Browser, Page, browsing
from helpers.console_pages import check_rules
from helpers.endpoint_process import Serve
from helpers.small_flat import ROLE

pytestmark = [pytest.mark.deep, NEEDS_BROWSER, pytest.mark.timeout(1200)]


@pytest.fixture
def chromium(tmp_path: Path) -> Iterator[Browser]:
    with browsing(tmp_path / "profile") as browser:
        yield browser


def specification(world: str) -> str:
    """Two drives through a world: the second one has too little time."""
    requests = [
        {
            "maxJobDurationInSeconds": 300,
            "iamRole": ROLE,
            "seed": 1,
            "requirements": [{"kind": "time_limit", "name": "quick", "limit_s": limit_s}],
            "robotApplications": [{"application": "scout", "launchConfig": {}}],
            "simulationApplications": [
                {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": world}]}
            ],
        }
        for limit_s in (90.0, 1.0)
    ]
    batch = {"batchPolicy": {"maxConcurrency": 1}, "createSimulationJobRequests": requests}
    steps = {"drive": {"operation": "StartSimulationJobBatch", "input": batch}}
    return json.dumps({"version": 1, "name": "drives", "steps": steps}, indent=1)


def fill(page: Page, selector: str, text: str) -> None:
    """Types into a field, as its page notices."""
    field = f"document.querySelector({json.dumps(selector)})"
    page.evaluate(f"{field}.value = {json.dumps(text)}; {field}.dispatchEvent(new Event('input', {{bubbles: true}}))")


def choose_file(page: Page, selector: str, length: int) -> None:
    """Chooses a file of comments."""
    page.evaluate(
        "const data = new DataTransfer();"
        f"data.items.add(new File(['#'.repeat({length})], 'long.yaml'));"
        f"const field = document.querySelector({json.dumps(selector)});"
        "field.files = data.files;"
        "field.dispatchEvent(new Event('change', {bubbles: true}))"
    )


def press(page: Page, selector: str) -> None:
    """Reaches a button with the keyboard and presses it; the page is another one then."""
    page.evaluate("window.isBefore = true")
    page.evaluate(f"document.querySelector({json.dumps(selector)}).focus()")
    for kind in ("keyDown", "keyUp"):
        page.send("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")
    page.wait(lambda page: page.evaluate("document.readyState === 'complete' && !window.isBefore"), selector)


def look_at(page: Page, axe: str, url: str) -> None:
    """Sees that a page fits narrow and wide windows, and keeps the rules of accessible pages."""
    for width in (400, 1280):
        page.load(url, width)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, url
        check_rules(page, axe)


def test_worlds_and_runs_are_started_and_failed_jobs_run_again(
    serve: Serve, service: Any, chromium: Browser, prefect_server: str, axe: str
) -> None:
    with serve(PREFECT_API_URL=prefect_server) as served, chromium.page() as page:
        served.wait_until_ready()
        console = f"{served.url}/console"
        look_at(page, axe, f"{console}/worlds/new")
        page.wait_for_text("The first world")
        fill(page, "[name=room-0-area]", "1")
        page.wait_for_text("Room 1.DesiredShape.Area: 1.0: 2 or more would be right")
        check_rules(page, axe)
        fill(page, "[name=room-0-area]", "16")
        page.wait_for_text("The first world")
        for name in ("plans", "interiors"):
            fill(page, f"[name={name}]", "1")
        press(page, "[value=remove-2]")
        press(page, "[name=name]")  # Enter in a field shows the plan, and makes nothing
        assert page.address == f"{console}/worlds/new"
        assert not service.catalog.list("world-template").resources
        press(page, "[value=create]")
        assert "/console/generations/" in page.address
        generation = page.address.rpartition("/")[2]
        page.wait(lambda _: service.catalog.list("world").resources, "a world")
        world = service.arn("world", f"{generation}/world-1")

        look_at(page, axe, f"{console}/runs/new?spec=quickstart")
        fill(page, "#spec-text", specification(world).replace('"StartSim', '"StartSin'))
        page.wait_for_text("Line 6", "did you mean 'StartSimulationJobBatch'?")
        check_rules(page, axe)
        choose_file(page, "#spec-file", 600_000)
        page.wait_for_text("This is too large: the form may have at most 500 KB")
        fill(page, "#spec-text", specification(world))
        page.wait_for_text("valid", "drives")
        press(page, "[value=start]")
        run = page.address
        page.wait_for_text("Goes on also when this page is closed")
        check_rules(page, axe)
        page.load(f"{console}/runs", 400)
        page.wait_for_text("running", "0 of 1 steps ended")
        check_rules(page, axe)
        page.load(run, 400)
        page.wait_for_text("of 2 jobs ended")  # its batch, live
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        page.wait_for_text("Run it again", "1 of 2 jobs passed")  # the page of the run that has ended
        check_rules(page, axe)
        page.evaluate("document.querySelector('.act').open = true")
        press(page, ".act button")
        page.wait_for_text("Run it again", "0 of 1 jobs passed", "rerun")
        assert page.address != run

        page.load(run, 1280)
        page.evaluate("document.querySelector('main a[href*=\"/batches/\"]').click()")
        page.wait_for_text("2 of 2 jobs ended", "failed", "Run failed again")
        assert "Cancel" not in page.text
        assert [each for each in page.complaints if "400" not in each] == []
        served.process.terminate()
        assert served.process.wait(200) == 0, served.log.read_text()
    assert "Traceback" not in served.log.read_text()


def test_a_value_can_be_typed_while_the_text_is_checked(
    serve: Serve, chromium: Browser, axe: str, prefect_server: str
) -> None:
    text = {
        "version": 1,
        "name": "flats",
        "parameters": {"label": {"default": "flat", "description": "Name"}, "arm": {"enum": ["a", "b"]}},
        "steps": {
            "flat": {
                "operation": "CreateWorldTemplate",
                "input": {
                    "name": "${{ parameters.label }}",
                    "templateBody": {},
                    "tags": {"x": "${{ parameters.arm }}"},
                },
            }
        },
    }
    with serve(PREFECT_API_URL=prefect_server) as served, chromium.page() as page:
        served.wait_until_ready()
        look_at(page, axe, f"{served.url}/console/runs/new")
        fill(page, "#spec-text", json.dumps(text))
        page.wait_for_text("Before it can start, arm needs a value.")
        check_rules(page, axe)
        page.evaluate("document.querySelector('[name=\"parameter.label\"]').focus()")
        page.send("Input.insertText", text="my flt")
        page.evaluate("document.activeElement.setSelectionRange(5, 5)")
        page.evaluate("window.before = document.activeElement")
        page.wait(lambda page: page.evaluate("!window.before.isConnected"), "the answer of the check")
        page.send("Input.insertText", text="a")
        assert page.evaluate("document.activeElement.name") == "parameter.label"
        assert page.evaluate("document.activeElement.value") == "my flat"
        assert page.evaluate("document.querySelector('[name=\"parameter.arm\"]').value") == ""
        assert page.complaints == []
