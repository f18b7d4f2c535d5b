"""Cards of runs, jobs and worlds in notebooks."""

import base64
import re
from collections.abc import Callable
from html.parser import HTMLParser
from typing import Any

from helpers.night_records import make_job, make_night, store_night
from hypothesis import example, given
from hypothesis import strategies as st

from prefect_robomaker import Run, World, results
from prefect_robomaker.deployments.in_python.html import badge, card, image, line, table
from prefect_robomaker.schemas.reports.causes import FailureGroup, Why
from prefect_robomaker.tasks.causes.stored import write_why
from prefect_robomaker.tasks.inspection.reports import short_name
from prefect_robomaker.tasks.service.service import Service

HOSTILE = "<script>alert(1)</script>\"'&"


class Tags(HTMLParser):
    """The elements and texts of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.text = ""
        self.feed(str(page))
        self.close()

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.names.add(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


def run_of(service: Service, jobs: Any) -> Run:
    record = make_night(jobs, runs=service.settings.home / "runs")
    store_night(record)
    with service.activated():
        return results()


@example(HOSTILE, "<b>")
@given(st.text(), st.text())
def test_texts_stay_texts(text: str, other: str) -> None:
    made = Tags(card(text, other, line(text), table(("a",), [(text,)], other), table((), [(text, badge(other))])))

    assert made.names <= {"div", "strong", "span", "table", "thead", "tbody", "tr", "th", "td"}
    assert text in made.text
    assert other in made.text


def test_a_run_whose_jobs_all_passed_says_passed(service: Service) -> None:
    run = run_of(service, "PP")
    assert "passed2 of 2 jobs passed; all well" in Tags(run._repr_html_()).text
    assert run.outcome == "succeeded"


def test_failures_stand_first_and_what_is_left_out_is_counted(service: Service) -> None:
    jobs = [make_job(index, "P") for index in range(50)]
    jobs[44] = make_job(44, "F").model_copy(update={"test": HOSTILE, "verdict_reason": f"{HOSTILE}\nlog"})
    page = run_of(service, jobs)._repr_html_()
    text = Tags(page).text

    assert "script" not in Tags(page).names
    assert text.index(HOSTILE) < text.index("world-1 scout")
    assert "and 10 more; .jobs has all" in text
    assert "a simulation's verdict is fail" not in text, "the record says succeeded"
    assert "49 of 50 jobs passed" in text
    assert "log" not in text


def test_a_job_shows_its_requirements_and_a_lost_world_is_no_error(service: Service) -> None:
    (job,) = run_of(service, [make_job(0, "F")]).jobs
    text = Tags(job._repr_html_()).text

    assert "gentlefailed9 N, at most 5 N asked" in text
    assert "There is no plan: " in text
    assert "outputs not known: " in text, "its job is not in the catalog"


def test_a_failed_run_says_why(service: Service) -> None:
    run = run_of(service, "FP")
    assert "why: " not in Tags(run._repr_html_()).text

    group = FailureGroup(requirement=HOSTILE, failed=1, job="world-0", command="x")
    write_why(Why(trials=2, failed=1, groups=[group]), run.folder)

    page = run._repr_html_()
    assert f"why: {run.why and run.why.headline}" in Tags(page).text
    assert "script" not in Tags(page).names


def test_a_job_shows_its_requirements_before_its_outputs_which_are_folded(
    service: Service, order: Callable[..., dict[str, Any]], simulate: Callable[..., dict[str, Any]]
) -> None:
    done = simulate(order({"SLEEP_S": "0.1"}))
    record = make_job(0, "F").model_copy(update={"arn": done["arn"], "label": done["arn"].rpartition("/")[2]})
    (job,) = run_of(service, [record]).jobs
    page = job._repr_html_()

    assert page.index("gentle") < page.index(f'<summary style="cursor:pointer">{len(job.outputs)} outputs</summary>')
    assert page.index("<details>") < page.index("result.json") < page.index("</details>")


def test_a_world_shows_its_plan_as_an_image_in_which_nothing_acts(
    service: Service, known_worlds: None, generate: Callable[..., dict[str, Any]]
) -> None:
    (arn,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    world = World(arn, short_name(arn), service)
    page = world._repr_html_()
    plan, picture = re.findall(r'src="data:image/(?:svg\+xml|png);base64,([^"]+)"', page)

    assert base64.b64decode(plan).decode() == world.plan
    assert base64.b64decode(picture) == world.picture
    assert Tags(page).names == {"div", "strong", "img"}
    assert f'alt="Plan of {world.name}"' in page


def test_jobs_and_worlds_have_the_names_that_people_read(
    service: Service, known_worlds: None, generate: Callable[..., dict[str, Any]]
) -> None:
    (arn,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    named = {"name": "scout in two rooms 1", "world": short_name(arn), "world_name": "two rooms 1"}
    run = run_of(service, [make_job(0, "F").model_copy(update=named)])
    (job,), (world,), (row,) = run.jobs, run.worlds, run.rows

    assert Tags(job._repr_html_()).text.startswith(f"scout in two rooms 1 {job.id} failed")
    assert (world.name, world.id) == ("two rooms 1", short_name(arn))
    assert Tags(world._repr_html_()).text.startswith(f"two rooms 1 {world.id}")
    assert (row.job_name, row.world_name) == ("scout in two rooms 1", "two rooms 1")
    with service.activated():
        assert run._names_of_worlds([arn, f"{arn}9"]) == {arn: "two rooms 1", f"{arn}9": short_name(f"{arn}9")}


def test_an_empty_image_is_none() -> None:
    assert image(b"", "image/png", "nothing") == ""
