"""The pages of the local server, seen in Chromium by a user who came by the printed link."""

import io
import json
import os
import uuid
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from helpers.browser import NEEDS_BROWSER, Browser, Page, browsing
from helpers.command_here import Command
from helpers.prefect_server import server_settings
from helpers.processes import wait_for
from helpers.small_flat import BODY

from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.deployments.prefect_server.secret import auth_string
from prefect_robomaker.flows.request_defaults import LOCAL_ROLE

pytestmark = [pytest.mark.deep, NEEDS_BROWSER, pytest.mark.timeout(1200)]

NAME = f"seen-{uuid.uuid4().hex[:8]}"
SPEC = {
    "version": 1,
    "name": NAME,
    "steps": {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "two rooms", "templateBody": BODY}},
        "worlds": {
            "operation": "CreateWorldGenerationJob",
            "input": {
                "template": "${{ template.arn }}",
                "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
                "seed": 7,
            },
        },
    },
}


def status() -> str:
    """What `robomaker server status` prints."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    home = str(server_settings().home)
    out = io.StringIO()
    with (
        mock.patch.dict(os.environ, {**kept, "ROBOMAKER_HOME": home, "PREFECT_HOME": home}, clear=True),
        redirect_stdout(out),
    ):
        assert main(["server", "status"]) == 0
    return out.getvalue()


def link() -> str:
    """The link that logs a browser in."""
    return status().split()[-1]


def click(page: Page, text: str, role: str = "tab") -> None:
    """Clicks what has a text, as a mouse does."""
    page.evaluate(
        f"(() => {{ const those = [...document.querySelectorAll({json.dumps(f'[role={role}], {role}')})];"
        f" const it = those.find((each) => each.innerText.trim().startsWith({json.dumps(text)}));"
        " for (const kind of ['mousedown', 'mouseup', 'click'])"
        " it.dispatchEvent(new MouseEvent(kind, {bubbles: true, button: 0})); })()"
    )


def focus(page: Page, label: str) -> None:
    """Puts the focus where a label belongs to."""
    page.evaluate(
        "(() => { const those = [...document.querySelectorAll('label')];"
        f" const it = those.find((each) => each.innerText.trim().startsWith({json.dumps(label)}));"
        " document.getElementById(it.htmlFor).focus(); })()"
    )


def choices_of(label: str) -> str:
    """An expression for the choices that a label belongs to."""
    return (
        "document.getElementById([...document.querySelectorAll('label')]"
        f".find((each) => each.innerText.trim().startsWith({json.dumps(label)})).htmlFor)"
    )


def fits(page: Page, width: int) -> None:
    """Sees that a page of that width needs no scrolling to the side, once it is laid out anew."""
    page.resize(width)
    page.wait(lambda page: page.evaluate(f"innerWidth === {width}"), f"{width} pixels")
    page.wait(lambda page: page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "a page that fits")


SELECT_VIDEO = choices_of("video")


def task_runs_below(name: str) -> set[str]:
    """The task runs of the subflows of a flow run, as far as the server knows them; none before the last one."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName, FlowRunFilterParentFlowRunId

    with get_client(sync_client=True) as client:
        (run,) = client.read_flow_runs(flow_run_filter=FlowRunFilter(name=FlowRunFilterName(any_=[name])))
        below = FlowRunFilter(parent_flow_run_id=FlowRunFilterParentFlowRunId(any_=[run.id]))
        names = {task.name for task in client.read_task_runs(flow_run_filter=below)}
    return names if any(each.startswith("upload-") for each in names) else set()


@pytest.fixture(scope="module")
def printed(prefect_server: str) -> str:
    """The link that `browser` has followed."""
    return link()


@pytest.fixture(scope="module")
def browser(printed: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser whose user has followed the link."""
    with browsing(tmp_path_factory.mktemp("browser") / "profile") as browser:
        with browser.page(printed) as page:
            page.wait(lambda page: "/dashboard" in page.address, "the dashboard")
            page.wait_for_text("Dashboard", "Runs")
            assert "password" not in page.text.lower()
        yield browser


def test_a_link_logs_one_browser_in(browser: Browser, printed: str, prefect_server: str, tmp_path: Path) -> None:
    """Another browser, and one without a link, are told how to get one."""
    assert auth_string(server_settings()).partition(":")[2] not in printed
    with browser.page(printed) as page:  # from a bookmark, say
        page.wait(lambda page: "/dashboard" in page.address, "the dashboard, without a new link")

    runs = f"{prefect_server.removesuffix('/api')}/v2/runs"
    with browsing(tmp_path / "second") as second, second.page(printed) as page:
        page.wait_for_text("does not work any more", "robomaker server status")
        assert printed.partition("#")[2] not in page.address
        assert page.evaluate("localStorage.getItem('prefect-password')") is None
        page.go(runs)
        page.wait_for_text("Log in with a link", "robomaker server status")
        for width in (400, 1280):
            fits(page, width)
        page.wait(lambda page: page.evaluate("document.querySelector('img').naturalWidth") > 0, "the picture")
    with browser.page(runs) as page:
        page.evaluate("document.cookie = `robomaker-login-${location.port}=; path=/; max-age=0`")
        page.go(runs)  # logged in before there was a cookie
        page.wait(lambda page: "/v2/runs" in page.address, "the page that was asked for")


def test_block_types_show_our_logo(browser: Browser, prefect_server: str) -> None:
    from pydantic import SecretStr

    from prefect_robomaker.deployments.blocks import RobomakerCatalog

    RobomakerCatalog(url=SecretStr("sqlite://")).save(NAME, overwrite=True)
    with browser.page(f"{prefect_server.removesuffix('/api')}/v2/blocks/catalog") as page:
        page.wait_for_text("RoboMaker Catalog")
        shown = "[...document.images].some((it) => it.src.endsWith('/robomaker/logo.svg') && it.naturalWidth > 0)"
        page.wait(lambda page: page.evaluate(shown), "the logo")


def test_a_run_is_listed_with_its_tasks_logs_and_artifacts(
    browser: Browser, prefect_server: str, tmp_path: Path, robomaker_at_server: Command
) -> None:
    from prefect.settings import PREFECT_LOGGING_TO_API_ENABLED, temporary_settings

    spec = tmp_path / "spec.yaml"
    spec.write_text(json.dumps(SPEC))
    with temporary_settings({PREFECT_LOGGING_TO_API_ENABLED: True}):
        ended = robomaker_at_server("run", spec)
    assert ended.code == 0, ended.err
    wait_for(lambda: task_runs_below(str(spec)), "its task runs, which reach the server late")
    pages = next(line.split()[-1] for line in ended.out.splitlines() if line.startswith("  prefect"))

    with browser.page(pages) as page:
        page.wait(lambda page: "/dashboard" in page.address, "the dashboard")
        page.go(f"{prefect_server.removesuffix('/api')}/v2/runs")
        page.wait_for_text(str(spec))
        assert "Can't connect" not in page.text
        click(page, str(spec), "a")
        page.wait_for_text("Completed", "RunPipeline", "Finished in state Completed")  # its log
        click(page, "Artifacts")
        page.wait_for_text("MARKDOWN")
        click(page, "Subflow Runs")
        page.wait_for_text("generation-")
        click(page, "generation-", "a")
        page.wait_for_text("PerformWorldGenerationJob", "Parent Run")
        click(page, "Task Runs")
        page.wait_for_text("/world-1", "upload-")


def test_limits_are_shown(browser: Browser, prefect_server: str) -> None:
    from prefect_robomaker.tasks.execution.batch_slots import Slots

    name = f"robomaker-{NAME}"
    with Slots(name, 3, 2) as slots:
        with browser.page(f"{prefect_server.removesuffix('/api')}/v2/concurrency-limits") as page:
            page.wait_for_text("Global Concurrency Limits", name)
        slots.remove()


@pytest.fixture
def form(browser: Browser, prefect_server: str) -> Iterator[Any]:
    """Opens the form of an operation's deployment."""
    from prefect.client.orchestration import get_client

    from prefect_robomaker.deployments.deploying.registration import form_schema

    made: list[Any] = []

    def open_form(operation: str) -> tuple[Any, str]:
        flow = getattr(import_module("prefect_robomaker.flows.operations"), operation)
        with get_client(sync_client=True) as client:
            deployment = client.create_deployment(
                client.create_flow(flow), f"form-{uuid.uuid4().hex}", parameter_openapi_schema=form_schema(flow),
                enforce_parameter_schema=True,
            )  # fmt: skip
        made.append(deployment)
        return deployment, f"{prefect_server.removesuffix('/api')}/v2/deployments/deployment/{deployment}/run"

    yield open_form
    with get_client(sync_client=True) as client:
        for deployment in made:
            client.delete_deployment(deployment)


def test_the_form_of_a_simulation_job_describes_its_parameters_and_starts_it(browser: Browser, form: Any) -> None:
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterId

    deployment, address = form("CreateSimulationJob")
    with browser.page(address) as page:
        text = page.wait_for_text("clientRequestToken")
        for name, description in {
            "maxJobDurationInSeconds (Optional)": "Wall-clock limit in seconds",  # as for callers in Python
            "failureBehavior (Optional)": "After a crash Fail (the default) ends the job",
            "compute (Optional)": "Limits on the job's use of the machine.",
            "video (Optional)": "Extension: whether a video is made: none (the default)",
        }.items():
            assert f"{name}\n\n{description}" in text or f"{name}\n{description}" in text, text
        focus(page, "maxJobDurationInSeconds")
        page.evaluate("document.activeElement.select()")  # what is there by default is written over
        page.send("Input.insertText", text="60")
        shown = f"{SELECT_VIDEO}.innerText + {choices_of('failureBehavior')}.innerText"
        assert page.evaluate(shown) == "noneFail"  # the defaults
        assert page.evaluate(f"{choices_of('seed')}.tagName") == "INPUT"
        page.evaluate(f"{SELECT_VIDEO}.click()")
        page.wait_for_text("none", "on-failure", "always")
        click(page, "on-failure", "option")
        # What is sent is what is shown; while the choices are open, the page takes no other click.
        chosen = f"!document.querySelector('[role=listbox]') && {SELECT_VIDEO}.innerText.includes('on-failure')"
        page.wait(lambda page: page.evaluate(chosen), "the choice")
        click(page, "Submit", "button")

        def ordered(_: Page) -> Any:
            with get_client(sync_client=True) as client:
                wanted = DeploymentFilter(id=DeploymentFilterId(any_=[deployment]))
                return client.read_flow_runs(deployment_filter=wanted)

        (run,) = page.wait(ordered, "the run of the form")
    given = {name: value for name, value in run.parameters.items() if value not in (None, [], {})}
    defaults = {"failureBehavior": "Fail"}
    assert given == {"maxJobDurationInSeconds": 60, "iamRole": LOCAL_ROLE, "video": "on-failure", **defaults}


def test_the_form_of_a_batch_describes_its_parameters(browser: Browser, form: Any) -> None:
    _, address = form("StartSimulationJobBatch")
    with browser.page(address) as page:
        text = page.wait_for_text("createSimulationJobRequests", "batchPolicy (Optional)", "tags (Optional)")
        click(page, "Add item", "button")
        page.wait_for_text("iamRole (Optional)", "useDefaultApplications (Optional)")
        assert page.evaluate(f"{SELECT_VIDEO}.innerText") == "none"
        for width in (400, 1280):
            fits(page, width)

    assert "The jobs, 1 to 1000, in order." in text
    assert "Limits of the batch." in text
    assert "createSimulationJobRequests (Optional)" not in text
