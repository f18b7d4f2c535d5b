"""Pages of fleets, applications and nights in Chromium: axe-core's rules, narrow by day and wide by night."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.browser import NEEDS_BROWSER, Page, browsing
from helpers.client_environments import node_modules
from helpers.deployed_robots import Yard, bad, deployable, good
from helpers.endpoint_here import ServeHere
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, NEEDS_BROWSER, pytest.mark.timeout(1200)]


@pytest.fixture
def axe(pytestconfig: pytest.Config) -> str:
    folder = Path(__file__).parents[1] / "axe"
    return (node_modules(pytestconfig, folder) / "axe-core" / "axe.min.js").read_text()


@pytest.fixture
def paths(service: Service) -> list[str]:
    """Addresses of pages that have something to show."""
    yard = Yard(service)
    robots = [yard.robot(f"rover-{number}", bad if number == 4 else good) for number in range(6)]
    application = deployable(yard.fleets, "X86_64")
    config = {"concurrentDeploymentPercentage": 34, "failureThresholdPercentage": 60}
    deployment = yard.fleets.deploy(yard.arn, application, "once", deploymentConfig=config)["arn"]
    yard.run(deployment)
    runs = service.settings.home / "runs"
    for night, verdicts in enumerate(("PPPPPPPPPP", "PPPPPPPPPF", "PPFFFFEFFF")):
        metrics = {"duration_s": 10.0 + night, "distance_m": 20.0, "collisions": 3.0}
        jobs = [make_job(index, letter, night=night, metrics=metrics) for index, letter in enumerate(verdicts)]
        for index, each in enumerate(jobs):
            metrics = {**each.metrics, "distance_m": 20.0 + index * (-1) ** night, "clearance_m": 0.1 * index}
            jobs[index] = each.model_copy(update={"metrics": metrics if each.metrics else {}})
        store_night(make_night(jobs, night, runs=runs))
    before, _, after = sorted(folder.name for folder in runs.iterdir())
    ids = [arn.partition("/")[2] for arn in (yard.arn, robots[4], application)]
    return [
        f"/deployments/{deployment.partition('/')[2]}", "/history/nightly", f"/compare?before={before}&after={after}",
        f"/fleets/{ids[0]}", f"/robots/{ids[1]}", f"/applications/robot-application/{ids[2]}",
        "/fleets", "/robots", "/applications", "/batches?status=Completed",
    ]  # fmt: skip


@pytest.fixture
def tab(tmp_path: Path) -> Iterator[Page]:
    with browsing(tmp_path / "profile") as browser, browser.page() as page:
        yield page


def test_pages_keep_the_rules(serve_here: ServeHere, paths: list[str], tab: Page, axe: str) -> None:
    with serve_here() as served:
        for path, (width, scheme) in itertools.product(paths, ((400, "light"), (1280, "dark"))):
            tab.load(f"{served.url}/console{path}", width)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width, path
            tab.evaluate(f"{axe}\n;null")
            tab.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            script = "axe.run().then((found) => found.violations.map((each) => `${each.id}: ${each.nodes[0].html}`))"
            assert tab.evaluate(script) == [], (path, scheme)
    assert tab.complaints == []


LONG = "indoor-navigation-through-every-room-with-two-robots-nightly"


def test_pages_fit_a_telephone_where_names_are_long(serve_here: ServeHere, service: Service, tab: Page) -> None:
    runs = service.settings.home / "runs"
    document = SimulationJobDocument(
        request={}, seed=3, verdict="FAIL", verdict_reason=f"{'quick-' * 9}s: 9 s, 1 s asked"
    )
    tags = {"robomaker:axis:STOP_DISTANCE_BEFORE_WALLS_M": "=30.5", "team": "n" * 60}
    job = service.store_job("simulation-job", "sim", document, tags=tags, token=None, status="Completed").id
    named: list[str] = []
    for night in range(2):
        jobs = [make_job(index, letter, night=night) for index, letter in enumerate("PF" if night else "PP")]
        made = make_night(jobs, night, runs=runs)
        run_id = f"{LONG}-{made.run_id.rpartition('-')[2]}"
        night_record = made.model_copy(
            update={
                "name": LONG,
                "run_id": run_id,
                "run_dir": runs / run_id,
                "report_path": runs / run_id / "report.html",
            }
        )
        store_night(night_record)
        named.append(run_id)
    pages = [
        *("", "/failures", "/runs", "/jobs", "/batches", "/worlds", "/runs/new"),
        f"/jobs/{job}", f"/search?q={'a' * 200}",
        *(f"/runs/{each}" for each in named),
        f"/compare?before={named[0]}&after={named[1]}", f"/history/{LONG}",
    ]  # fmt: skip
    with serve_here() as served:
        for path in pages:
            tab.load(f"{served.url}/console{path}", 400)
            wide = "[...document.querySelectorAll('main *')].filter((e) => e.getBoundingClientRect().right > 401)"
            found = tab.evaluate(f"{wide}.map((e) => e.outerHTML.slice(0, 90)).slice(0, 3)")
            assert tab.evaluate("document.documentElement.scrollWidth") <= 400, (path, found)
            assert tab.evaluate("document.querySelector('h1').innerText"), path


_OVERLAPS = """(() => {
  const boxes = [...document.querySelectorAll('.changes > .change')].map((each) => each.getBoundingClientRect());
  const apart = (one, other) => one.right <= other.left || other.right <= one.left || one.bottom <= other.top
    || other.bottom <= one.top;
  const overlaps = boxes.flatMap((one, i) => boxes.slice(i + 1).filter((other) => !apart(one, other)));
  return [boxes.length, overlaps.length];
})()"""


def test_changes_of_a_run_do_not_lie_on_top_of_each_other(serve_here: ServeHere, paths: list[str], tab: Page) -> None:
    run = paths[2].rpartition("after=")[2]
    with serve_here() as served:
        for width in (400, 1000, 1280, 1600):
            tab.load(f"{served.url}/console/runs/{run}", width)
            count, overlaps = tab.evaluate(_OVERLAPS)
            assert count >= 2, width
            assert overlaps == 0, width
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
